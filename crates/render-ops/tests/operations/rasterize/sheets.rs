//! A law of exact coverage: a sheet covers what its faces cover that know nothing of each other.

use super::exact::exact;
use super::*;
use bokashi_render_ops::{Background, Cull, Mesh, RasterOptions, Size, interpolate, rasterize};

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

/// How much of each pixel is covered, and its gradient.
fn mask(clip: &Clip, mesh: &Mesh, options: RasterOptions) -> [Vec<f64>; 2] {
    let tape = Tape::<f64>::new();
    let positions = tape.leaf(&tensor(clip));
    let fragments = rasterize(positions, mesh, options.creases(&[])).unwrap();
    let ones = tape.constant(&Tensor::full([clip.len(), 1], 1.0));
    let surface = interpolate(ones, &fragments).unwrap();
    let image = fragments.picture(surface, Background::Zero).unwrap().image().unwrap();
    let upstream =
        Tensor::from_flat_fn(image.shape(), |k| ((k * 37 + 11) % 17) as f64 / 17.0 - 0.4);
    let gradients = tape.vjp(&[(image, &upstream)]).unwrap();
    [image.value().data().to_vec(), gradients.get_or_zeros(positions).data().to_vec()]
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

    /// Of faces without a vertex in common none is known to lie beside another.
    #[test]
    fn a_sheet_covers_what_its_faces_cover_each_by_itself(
        (clip, faces) in crumpled(),
        (width, height) in image(),
        cull in prop_oneof![Just(Cull::None), Just(Cull::Back), Just(Cull::Front)],
        // Each face has seams, or each third, or none.
        every in prop_oneof![Just(1), Just(3), Just(usize::MAX)],
    ) {
        let options = exact(Size { width, height }).cull(cull);
        let corners = faces.concat();
        let loose_clip: Clip = corners.iter().map(|&vertex| clip[vertex as usize]).collect();
        let loose_faces = (0..faces.len() as u32).map(|k| [0, 1, 2].map(|corner| 3 * k + corner));
        let loose = Mesh::new(loose_faces.collect(), loose_clip.len()).unwrap();
        let [expected, loose_bar] = mask(&loose_clip, &loose, options);
        let mut expected_bar = vec![0.0; 4 * clip.len()];
        for (&vertex, bar) in corners.iter().zip(loose_bar.chunks(4)) {
            for (sum, bar) in expected_bar[4 * vertex as usize..].iter_mut().zip(bar) {
                *sum += bar;
            }
        }
        let sheet = Mesh::new(faces, clip.len()).unwrap().with_seams(|face, _| face % every == every - 1);
        let [found, found_bar] = mask(&clip, &sheet, options);
        for (at, (found, expected)) in found.iter().zip(&expected).enumerate() {
            prop_assert!((found - expected).abs() < 1e-12, "{at}: {found} {expected}");
        }
        // What is added up at edges inside the sheet cancels but for roundings.
        let size = expected_bar.iter().fold(1.0, |most: f64, bar| most.max(bar.abs()));
        for (at, (found, expected)) in found_bar.iter().zip(&expected_bar).enumerate() {
            prop_assert!((found - expected).abs() < 1e-7 * size, "{at}: {found} {expected}");
        }
    }
}
