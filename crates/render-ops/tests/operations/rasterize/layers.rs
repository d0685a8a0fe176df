//! Layers in depth: each face that covers a pixel centre, once, from front to back.

use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{
    Cull, Mesh, RasterOptions, Size, depth, depth_layers, rasterize, rasterize_behind,
};

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

#[test]
fn layers_of_another_size_are_refused() {
    let (clip, mesh) = scene(3);
    let tape = Tape::new();
    let front = rasterize(tape.leaf(&clip), &mesh, SIZE).unwrap();
    let error = rasterize_behind(&front, Size::square(8)).unwrap_err();
    let rule = "a layer needs the size of the layer in front, 150 x 131, got 8 x 8";
    assert_eq!(error.to_string(), rule);
}
