//! Laws of the outline: as much of each pixel is covered as with exact coverage, with the same gradient.

use super::exact::exact;
use super::*;
use bokashi_render_ops::{
    Background, BoundaryCounts, Cull, Mesh, RasterOptions, RenderError, Sampling, Size, composite,
    depth, differentials, eye_depth, interpolate, rasterize,
};

/// A sheet of 5 x 4 vertices, some of them far off, so that it folds and passes through itself; and
/// behind it or before it a face that may reach out of the depth range. Faces have any order.
pub(super) fn crumpled() -> impl Strategy<Value = (Clip, Vec<[u32; 3]>)> {
    let shifts = proptest::collection::vec(prop::array::uniform4(-0.25..0.25), 20);
    let depth = prop_oneof![4 => -0.9..0.9, 1 => -1.6..1.6];
    let loose = prop::array::uniform3((-1.3..1.3, -1.3..1.3, depth, 0.5..2.0));
    let mut faces = vec![[20, 21, 22]];
    for k in (0..15).filter(|k| k % 5 < 4) {
        faces.extend([[k, k + 1, k + 6], [k, k + 6, k + 5]]);
    }
    let faces = Just(faces).prop_shuffle();
    (shifts, loose, 0.0..2.0, faces).prop_map(|(shifts, loose, crumple, faces)| {
        let shifts: Vec<[f64; 4]> = shifts;
        let mut clip: Clip = (0..20)
            .map(|k| {
                let [x, y] = [0.35 * (k % 5) as f64 - 0.7, 0.45 * (k / 5) as f64 - 0.7];
                let [dx, dy, z, dw] = shifts[k].map(|shift| crumple * shift);
                let w = 1.0 + dw;
                [(x + dx) * w, (y + dy) * w, z * w, w]
            })
            .collect();
        clip.extend(loose.map(|(x, y, z, w)| [x * w, y * w, z * w, w]));
        (clip, faces)
    })
}

/// How much of each pixel is covered, its gradient, and what was resolved.
fn mask(clip: &Clip, mesh: &Mesh, options: RasterOptions) -> (Vec<f64>, Vec<f64>, BoundaryCounts) {
    let tape = Tape::<f64>::new();
    let positions = tape.leaf(&tensor(clip));
    let fragments = rasterize(positions, mesh, options.creases(&[])).unwrap();
    let ones = tape.constant(&Tensor::full([clip.len(), 1], 1.0));
    let surface = interpolate(ones, &fragments).unwrap();
    let image = composite(surface, &fragments, Background::Zero).unwrap().image().unwrap();
    let upstream =
        Tensor::from_flat_fn(image.shape(), |k| ((k * 37 + 11) % 17) as f64 / 17.0 - 0.4);
    let gradients = tape.vjp(&[(image, &upstream)]).unwrap();
    let counts = fragments.coverage.boundary_counts();
    (image.value().data().to_vec(), gradients.get_or_zeros(positions).data().to_vec(), counts)
}

/// Small images, and images so wide or so high that the ends of an edge are far from most of its pixels.
fn image() -> impl Strategy<Value = (usize, usize)> {
    let (short, long) = (1..6_usize, 300..3000_usize);
    prop_oneof![
        6 => (1..24_usize, 1..24_usize),
        1 => (long.clone(), short.clone()),
        1 => (short, long),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn as_much_is_covered_and_its_gradient_is_the_same(
        (clip, faces) in crumpled(),
        (width, height) in image(),
        cull in prop_oneof![Just(Cull::None), Just(Cull::Back), Just(Cull::Front)],
        // Each face has seams, or each third, or none.
        every in prop_oneof![Just(1), Just(3), Just(usize::MAX)],
    ) {
        let size = Size { width, height };
        let mesh = Mesh::new(faces, clip.len()).unwrap().with_seams(|face, _| face % every == every - 1);
        let all = exact(size).cull(cull);
        let (expected, expected_bar, most) = mask(&clip, &mesh, all);
        let (found, found_bar, counts) = mask(&clip, &mesh, all.sampling(Sampling::Outline));
        for (at, (found, expected)) in found.iter().zip(&expected).enumerate() {
            prop_assert!((found - expected).abs() < 1e-12, "{at}: {found} {expected}");
        }
        // Where pieces meet in two planes that are nearly one, what exact coverage adds up there cancels
        // but for roundings.
        let size = expected_bar.iter().fold(1.0, |most: f64, bar| most.max(bar.abs()));
        for (at, (found, expected)) in found_bar.iter().zip(&expected_bar).enumerate() {
            prop_assert!((found - expected).abs() < 1e-7 * size, "{at}: {found} {expected}");
        }
        prop_assert!(counts.pixels <= most.pixels);
    }
}

#[test]
fn an_outline_shows_one_colour_and_nothing_that_varies() {
    let (tape, size) = (Tape::<f64>::new(), Size::square(8));
    let clip = vec![[-0.7, -0.8, 0.2, 1.0], [0.9, -0.6, 0.0, 1.5], [0.1, 0.8, -0.3, 1.0]];
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let options = exact(size).sampling(Sampling::Outline);
    let fragments = rasterize(tape.leaf(&tensor(&clip)), &mesh, options).unwrap();
    let one_colour = Tensor::from([[0.25, 0.5]; 3]);
    let surface = interpolate(tape.leaf(&one_colour), &fragments).unwrap();
    for (k, entry) in surface.value().data().iter().enumerate() {
        approx::assert_relative_eq!(*entry, [0.25, 0.5][k % 2], max_relative = 1e-14);
    }
    let varying = tape.leaf(&Tensor::from([[0.25, 0.5], [0.25, 0.5], [0.25, 0.75]]));
    let told = |result: Result<_, RenderError>| result.map(drop).unwrap_err().to_string();
    for (message, name) in [
        (told(interpolate(varying, &fragments)), "interpolate"),
        (told(interpolate(varying, &fragments.still().on(&tape))), "interpolate"),
        (told(depth(&fragments)), "depth"),
        (told(eye_depth(&fragments).map(|found| found.values())), "eye_depth"),
        (told(differentials(&fragments)), "differentials"),
    ] {
        let rule = "needs fragments at pixel centres or with exact coverage, got those of an outline, \
                    which show attributes that are the same at all vertices and nothing else";
        assert_eq!(message, format!("{name} {rule}"));
    }
    let message = told(interpolate(tape.leaf(&Tensor::zeros([2, 1])), &fragments));
    assert!(message.contains("shape"), "{message}");
    // A place of the same tape that was an outline's is one of centres again.
    let centers = rasterize(tape.leaf(&tensor(&clip)), &mesh, size).unwrap();
    assert!(interpolate(varying, &centers).is_ok());
}

/// A face before another face that fills the image; then the same beside the other's edge.
#[test]
fn what_ends_before_a_surface_is_left_alone() {
    let size = Size::square(16);
    let quad = |left: f64, right: f64, z: f64| {
        [[left, -2.0], [right, -2.0], [right, 2.0], [left, 2.0]].map(|[x, y]| [x, y, z, 1.0])
    };
    let faces = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    let mesh = Mesh::new(faces, 8).unwrap();
    for (right, resolved) in [(2.0, 0), (0.47, 16)] {
        let clip: Clip = [quad(-2.0, right, 0.5), quad(-0.3, 0.21, 0.0)].concat();
        let (mask, _, counts) = mask(&clip, &mesh, exact(size).sampling(Sampling::Outline));
        assert_eq!(counts.pixels, resolved);
        let covered = 8.0 * (1.0 + f64::min(right, 1.0));
        assert!((mask.iter().sum::<f64>() - 16.0 * covered).abs() < 1e-12);
    }
}
