//! Faces in one plane, and faces close behind each other.

use super::exact::exact;
use super::*;

/// Two faces that lie in one plane of depths. Neither is thin.
fn two_faces() -> impl Strategy<Value = Clip> {
    let vertex = || (-1.2..1.2_f64, -1.2..1.2_f64, 0.5..2.0_f64);
    let plane = prop::array::uniform3(-0.4..0.4_f64);
    (prop::collection::vec(vertex(), 6), plane).prop_filter_map("thin", |(vertices, plane)| {
        let [one, x, y] = plane;
        let corner =
            |&(cx, cy, w): &(f64, f64, f64)| [cx * w, cy * w, (one + x * cx + y * cy) * w, w];
        let is_thin = |k: usize| {
            let [p, q, r] = [0, 1, 2].map(|i| (vertices[k + i].0, vertices[k + i].1));
            ((q.0 - p.0) * (r.1 - p.1) - (q.1 - p.1) * (r.0 - p.0)).abs() < 0.3
        };
        let clip = vertices.iter().map(corner).collect();
        (!is_thin(0) && !is_thin(3)).then_some(clip)
    })
}

const FACES: [[u32; 3]; 2] = [[0, 1, 2], [3, 4, 5]];

/// How many pixels' areas each of two faces covers.
fn areas<T: Scalar>(clip: &Clip, faces: [[u32; 3]; 2], size: Size) -> [f64; 2] {
    let tape = Tape::<T>::new();
    let mesh = Mesh::new(faces.to_vec(), 6).unwrap();
    let fragments = rasterize(tape.leaf(&tensor(clip)), &mesh, exact(size)).unwrap();
    let weights = fragments.weight.unwrap().value();
    let centers = fragments.coverage.centers();
    let mut areas = [0.0; 2];
    for (fragment, face) in fragments.coverage.faces().enumerate() {
        let weight = fragment.checked_sub(centers).map_or(1.0, |at| weights.data()[at].to_f64());
        areas[face] += weight;
    }
    areas
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(1000) })]

    /// However their vertices were rounded.
    #[test]
    fn of_faces_in_one_plane_the_lower_index_is_in_front(clip in two_faces(), width in 1..20_usize) {
        let size = Size { width, height: 20 - width };
        for faces in [FACES, [FACES[1], FACES[0]]] {
            let alone = areas::<f64>(&clip, [faces[0], [0; 3]], size)[0];
            let [single, double] = [areas::<f32>(&clip, faces, size), areas::<f64>(&clip, faces, size)];
            prop_assert!((double[0] - alone).abs() < 1e-9, "{double:?} {alone}");
            for (single, double) in single.into_iter().zip(double) {
                prop_assert!((single - double).abs() < 1e-4, "{single} {double}");
            }
        }
    }

    /// What lies in front by more than roundings can be is in front, whatever its index.
    #[test]
    fn of_faces_close_behind_each_other_the_nearer_is_in_front(
        clip in two_faces(),
        width in 1..20_usize,
    ) {
        let size = Size { width, height: 20 - width };
        for (gap, found) in [(1e-4, areas::<f32> as fn(&_, _, _) -> _), (1e-11, areas::<f64>)] {
            let mut clip = clip.clone();
            clip[3..].iter_mut().for_each(|[_, _, z, w]| *z -= gap * *w);
            let alone = areas::<f64>(&clip, [[0; 3], FACES[1]], size)[1];
            let [_, found] = found(&clip, FACES, size);
            prop_assert!((found - alone).abs() < 1e-4, "{found} {alone}");
        }
    }
}
