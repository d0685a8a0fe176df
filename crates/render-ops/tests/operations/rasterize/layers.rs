//! Layers in depth: each face that covers a pixel centre, once, from front to back.

use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{
    Cull, Fragments, Mesh, RasterOptions, RenderError, Size, depth, depth_layers, rasterize,
    rasterize_behind,
};
use proptest::prelude::*;
use rayon::ThreadPoolBuilder;

use super::{at_px, tensor};

const SIZE: Size = Size { width: 150, height: 131 };

/// Faces in and through each other, some of them twice, some through the eye.
fn scene(count: usize) -> (Tensor<f64>, Mesh) {
    let number = |k: usize| ((k * k * 31 + k * 7919 + 13) % 10007) as f64 / 5003.5 - 1.0;
    let clip = Tensor::from_fn([3 * count, 4], |[v, k]| match k {
        2 => 0.4 * number(5 * v + 2),
        3 if v % 11 == 3 => -0.3,
        3 => 1.0 + 0.3 * number(5 * v + 3),
        _ => number(5 * v + k),
    });
    let mut faces: Vec<[u32; 3]> =
        (0..count as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    // The same faces again: at the same depth everywhere.
    faces.extend_from_within(..count / 3);
    (clip, Mesh::new(faces, 3 * count).unwrap())
}

#[test]
fn the_layers_of_a_pixel_are_all_faces_that_cover_it_from_front_to_back() {
    let (clip, mesh) = scene(30);
    for cull in [Cull::None, Cull::Back] {
        let options = RasterOptions::new(SIZE).cull(cull);
        let tape = Tape::new();
        let clip = tape.leaf(&clip);
        // Each face alone.
        let mut expected = vec![Vec::new(); SIZE.pixels()];
        for (k, &face) in mesh.faces().iter().enumerate() {
            let one = Mesh::new(vec![face], mesh.vertex_count()).unwrap();
            let fragments = rasterize(clip, &one, options).unwrap();
            let depths = depth(&fragments).unwrap().value();
            for (pixel, &depth) in fragments.coverage.pixels().zip(depths.data()) {
                expected[pixel].push((depth, k));
            }
        }
        let layers = depth_layers(clip, &mesh, options, None).unwrap();
        assert!(layers.len() > 5, "{}", layers.len());
        let mut found = vec![Vec::new(); SIZE.pixels()];
        for layer in &layers {
            let faces = layer.coverage.faces();
            layer.coverage.pixels().zip(faces).for_each(|(pixel, face)| found[pixel].push(face));
        }
        let mut crossings = 0;
        for (mut expected, found) in expected.into_iter().zip(found) {
            expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
            let order: Vec<_> = expected.iter().map(|&(_, face)| face).collect();
            if order == found {
                continue;
            }
            // The depth of an operation may round another way than visibility does.
            crossings += 1;
            let depth_of = |face| expected.iter().find(|e| e.1 == face).expect("it covers it").0;
            let depths: Vec<f64> = found.iter().map(|&face| depth_of(face)).collect();
            assert_eq!(depths.len(), expected.len());
            assert!(depths.windows(2).all(|d| d[0] <= d[1] + 1e-12), "{depths:?}");
        }
        assert!(crossings < 20, "{crossings}");
        // No more of them than were asked for, and none behind the last.
        assert_eq!(depth_layers(clip, &mesh, options, Some(2)).unwrap().len(), 2);
        let last = layers.last().unwrap();
        assert_eq!(rasterize_behind(last, options).unwrap().coverage.count(), 0);
    }
}

#[test]
fn the_first_layer_is_what_is_seen_and_layers_have_the_weights_of_faces_alone() {
    let (clip, mesh) = scene(12);
    let tape = Tape::new();
    let clip = tape.leaf(&clip);
    let layers = depth_layers(clip, &mesh, SIZE, None).unwrap();
    let seen = rasterize(clip, &mesh, SIZE).unwrap();
    assert_eq!(layers[0].barycentrics.value(), seen.barycentrics.value());
    assert!(layers[0].coverage.triangle_ids() == seen.coverage.triangle_ids());
    for layer in &layers[1..] {
        let uv = layer.barycentrics.value();
        let faces: Vec<_> = layer.coverage.faces().collect();
        for (n, pixel) in layer.coverage.pixels().enumerate().step_by(97) {
            let one = Mesh::new(vec![mesh.faces()[faces[n]]], mesh.vertex_count()).unwrap();
            let alone = rasterize(clip, &one, SIZE).unwrap();
            let at = alone.coverage.fragment_at(pixel).expect("it covers the pixel");
            for k in 0..2 {
                let expected = alone.barycentrics.value()[[at, k]];
                approx::assert_relative_eq!(uv[[n, k]], expected, epsilon = 1e-14);
            }
        }
    }
}

/// Vertices on pixel centres or anywhere, before the eye or behind it, and few depths.
fn vertex(side: usize) -> impl Strategy<Value = [f32; 4]> {
    let on_centers = 0..side;
    let center = move |k: usize| (2 * k + 1) as f32 / side as f32 - 1.0;
    let on_centers =
        (on_centers.clone(), on_centers).prop_map(move |(x, y)| [center(x), center(y)]);
    let anywhere = prop::array::uniform2(-1.4..1.4_f32);
    let place = prop_oneof![on_centers, anywhere];
    let w = prop_oneof![8 => Just(1.0_f32), 4 => 0.3..2.0_f32, 1 => -1.0..0.1_f32];
    (place, 0..4_u8, w).prop_map(|([x, y], z, w)| [x * w, y * w, f32::from(z) / 5.0 * w, w])
}

/// Per layer: the faces that pixels see, and weights. The gradient of a sum over all.
type Found = (Vec<(Vec<u32>, Tensor<f32>)>, Option<Tensor<f32>>);

/// The faces, weights and gradient of the layers that `find` finds.
fn found_by(
    clip: &Tensor<f32>,
    find: impl for<'t> Fn(&Fragments<'t, f32>) -> Result<Vec<Fragments<'t, f32>>, RenderError>,
    mesh: &Mesh,
    options: RasterOptions,
) -> Found {
    let tape = Tape::new();
    let clip = tape.leaf(clip);
    let layers = find(&rasterize(clip, mesh, options).unwrap()).unwrap();
    let sums = layers.iter().map(|layer| layer.barycentrics.square().sum());
    let gradient = sums.reduce(|a, b| a * 0.7 + b).map(|sum| sum.backward().unwrap());
    let of_layer =
        |layer: &Fragments<'_, f32>| (layer.coverage.triangle_ids(), layer.barycentrics.value());
    let layers = layers.iter().map(of_layer).collect();
    (layers, gradient.map(|gradient| gradient.get(clip).unwrap().clone()))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(128) })]

    #[test]
    fn layers_found_at_once_are_those_found_one_behind_another(
        (side, clip) in (1..40_usize).prop_flat_map(|side| {
            (Just(side), prop::collection::vec(vertex(side), 3..12))
        }),
        corners in prop::collection::vec(prop::array::uniform3(0..12_u32), 0..40),
        culls_back in any::<bool>(),
        most in prop_oneof![Just(None), (0..9_usize).prop_map(Some)],
        threads in 1..4_usize,
    ) {
        let count = clip.len();
        let faces = corners.iter().map(|face| face.map(|corner| corner % count as u32)).collect();
        let mesh = Mesh::new(faces, count).unwrap();
        let clip = Tensor::from_fn([count, 4], |[v, k]| clip[v][k]);
        let cull = if culls_back { Cull::Back } else { Cull::None };
        let options = RasterOptions::new(Size { width: 15 * side, height: 3 * side }).cull(cull);
        let one_by_one = found_by(&clip, |first| {
            let mut layers = vec![first.clone()];
            while layers.last().unwrap().coverage.count() > 0 {
                layers.push(rasterize_behind(layers.last().unwrap(), options)?);
            }
            layers.pop();
            layers.truncate(most.unwrap_or(usize::MAX));
            Ok(layers)
        }, &mesh, options);
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let at_once = pool.install(|| {
            found_by(&clip, |first| depth_layers(first.clip, &mesh, options, most), &mesh, options)
        });
        prop_assert_eq!(one_by_one, at_once);
    }
}

#[test]
fn layers_of_another_size_are_refused() {
    let (clip, mesh) = scene(3);
    let tape = Tape::new();
    let front = rasterize(tape.leaf(&clip), &mesh, SIZE).unwrap();
    let error = rasterize_behind(&front, Size::square(8)).unwrap_err();
    let rule = "a layer needs the size of the layer in front, 150 x 131, got 8 x 8";
    assert_eq!(error.to_string(), rule);
}

#[test]
fn a_face_between_centres_is_in_no_layer() {
    // Vertices so near to a row or column of centres that rounding to the filter's units decides what they can touch.
    let size = Size::square(1024);
    let mut clip = vec![[-1.0, 1.0, -0.5, 1.0], [3.0, 1.0, -0.5, 1.0], [-1.0, -3.0, -0.5, 1.0]];
    for row in [0, 15, 16, 100, 511, 512, 1000] {
        for off in [0.4e-6, 0.9e-6, 1.1e-6, 1.5e-6, 2e-6, 3e-6, 6e-6] {
            let [low, high] = [f64::from(row) + 0.5 + off, f64::from(row) + 1.5 - off];
            for [p, q, r] in [
                [[99.7, low], [100.8, low + 0.3], [100.2, high]],
                [[low, 99.7], [low + 0.3, 100.8], [high, 100.2]],
            ] {
                clip.extend([p, q, r].map(|[x, y]| at_px(size, x, y)));
            }
        }
    }
    let faces = (0..clip.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let mesh = Mesh::new(faces, clip.len()).unwrap();
    let tape = Tape::<f64>::new();
    let layers = depth_layers(tape.constant(&tensor(&clip)), &mesh, size, None).unwrap();
    assert_eq!(layers.iter().map(|layer| layer.coverage.count()).collect::<Vec<_>>(), [1 << 20]);
    assert_eq!(rasterize_behind(&layers[0], size).unwrap().coverage.count(), 0);
}
