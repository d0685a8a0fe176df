//! Faces in one plane, and how near to each other planes may be.

use super::exact::exact;
use super::*;
use bokashi_render_ops::{Background, Mesh, Size, composite, interpolate, rasterize};

/// A number for each of three faces, and the same for all.
const SHADES: [f64; 3] = [0.2, 0.5, 0.8];
const ONE_SHADE: [f64; 3] = [1.0; 3];

/// Three triangles over one another in the image, as (x, y) and w of their corners.
type Corners = [[[f64; 3]; 3]; 3];

fn corners() -> impl Strategy<Value = Corners> {
    let shifts = prop::array::uniform9((-0.3..0.3, -0.3..0.3, 0.5..2.0));
    shifts.prop_map(|shifts| {
        let at = [[-0.7, -0.6], [0.8, -0.5], [0.0, 0.8]];
        [0, 1, 2].map(|face| {
            [0, 1, 2].map(|corner| {
                let (dx, dy, w): (f64, f64, f64) = shifts[3 * face + corner];
                [at[corner][0] + dx, at[corner][1] + dy, w]
            })
        })
    })
}

/// Clip positions on the plane whose depth z / w is `plane` of 1, x and y, by `offsets[face]` farther away.
fn on_plane(corners: &Corners, plane: [f64; 3], offsets: [f64; 3]) -> Clip {
    let vertices = corners.iter().zip(offsets).flat_map(|(face, offset)| {
        face.iter().map(move |&[x, y, w]| {
            let depth = plane[0] + plane[1] * x + plane[2] * y + offset;
            [x * w, y * w, depth * w, w]
        })
    });
    vertices.collect()
}

/// The picture `[H, W]` of the faces in the order `faces`, before -1.
fn seen<T: Scalar>(clip: &Clip, faces: [u32; 3], shades: [f64; 3], size: Size) -> Vec<f64> {
    let tape = Tape::<T>::new();
    let indices = faces.map(|face| [3 * face, 3 * face + 1, 3 * face + 2]);
    let mesh = Mesh::new(indices.to_vec(), 9).unwrap();
    let colors = Tensor::from_flat_fn([9, 1], |k| T::from_f64(shades[k / 3]));
    let fragments = rasterize(tape.leaf(&tensor(clip)), &mesh, exact(size).creases(&[])).unwrap();
    let surface = interpolate(tape.leaf(&colors), &fragments).unwrap();
    let background = tape.constant(&Tensor::new([1], vec![T::from_f64(-1.0)]).unwrap());
    let background = Background::Color(background);
    let image = composite(surface, &fragments, background).unwrap();
    image.image().unwrap().value().data().iter().map(|value| value.to_f64()).collect()
}

fn order() -> impl Strategy<Value = [u32; 3]> {
    Just([0, 1, 2]).prop_shuffle()
}

/// Offsets of the first face, and of the second and the third behind it.
fn apart(faces: [u32; 3], by: f64) -> [f64; 3] {
    let mut offsets = [0.0; 3];
    (0..3).for_each(|rank| offsets[faces[rank] as usize] = rank as f64 * by);
    offsets
}

fn largest_difference(found: &[f64], expected: &[f64]) -> f64 {
    found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]

    // Rounded, they pass through each other. In f64 faces far apart show what should be seen.
    #[test]
    fn of_faces_in_one_plane_the_lower_index_is_in_front_in_either_precision(
        corners in corners(),
        plane in (-0.3..0.3, -0.3..0.3, -0.3..0.3),
        faces in order(),
        (width, height) in (1..24_usize, 1..24_usize),
    ) {
        let size = Size { width, height };
        let plane = [plane.0, plane.1, plane.2];
        let expected = seen::<f64>(&on_plane(&corners, plane, apart(faces, 0.01)), faces, SHADES, size);
        let clip = on_plane(&corners, plane, [0.0; 3]);
        let error = largest_difference(&seen::<f64>(&clip, faces, SHADES, size), &expected);
        prop_assert!(error < 1e-12, "f64: {error:e}");
        let error = largest_difference(&seen::<f32>(&clip, faces, SHADES, size), &expected);
        prop_assert!(error < 4e-5, "f32: {error:e}");
    }

    // Some ten times what rounding can be in such scenes; the lower index lies behind.
    #[test]
    fn planes_that_are_farther_apart_than_rounding_are_no_tie_in_either_precision(
        corners in corners(),
        plane in (-0.3..0.3, -0.3..0.3, -0.3..0.3),
        faces in order(),
        (width, height) in (1..24_usize, 1..24_usize),
    ) {
        let size = Size { width, height };
        let plane = [plane.0, plane.1, plane.2];
        let by = |by: f64| on_plane(&corners, plane, apart(faces, -by));
        let expected = seen::<f64>(&by(0.01), faces, SHADES, size);
        let error = largest_difference(&seen::<f64>(&by(1e-12), faces, SHADES, size), &expected);
        prop_assert!(error < 1e-12, "f64: {error:e}");
        let error = largest_difference(&seen::<f32>(&by(1e-5), faces, SHADES, size), &expected);
        prop_assert!(error < 4e-5, "f32: {error:e}");
    }

    // The first ties with the second, and that with the third, and the first not with the third.
    #[test]
    fn planes_that_tie_in_a_chain_leave_no_hole(
        corners in corners(),
        plane in (-0.3..0.3, -0.3..0.3, -0.3..0.3),
        faces in order(),
        steps in prop::array::uniform3(-1.0..1.0),
        power in -8.0..-6.0,
        (width, height) in (1..24_usize, 1..24_usize),
    ) {
        let size = Size { width, height };
        let plane = [plane.0, plane.1, plane.2];
        let steps = steps.map(|step| step * f64::powf(10.0, power));
        let clip = on_plane(&corners, plane, steps);
        let expected = seen::<f64>(&clip, faces, ONE_SHADE, size);
        let error = largest_difference(&seen::<f32>(&clip, faces, ONE_SHADE, size), &expected);
        prop_assert!(error < 4e-5, "{error:e}");
    }
}
