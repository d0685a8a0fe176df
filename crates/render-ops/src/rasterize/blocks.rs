//! Small faces, drawn in blocks of pixels.
//!
//! A row of a small face has a few pixels, and where they start and end can't be foretold. So all
//! blocks that the face can touch are drawn, and nothing is decided from pixel to pixel. The picture
//! is that of `setup`, whose pixels cost more: what it asks of a face holds here beforehand.
//!
//! # Which faces
//! All vertices are in view, none is close to the near plane, and none was multiplied. So
//! `|x| <= width w` and `|y| <= height w`, and a vertex's extents are at most `2 width w` and
//! `2 height w`. The error bound of `setup` is then below `65 eps width height w^2` with the largest
//! w, where 64 would be enough without rounding. Pixels above this bound are surely covered, and those
//! below its negative surely are not. A face with a pixel between them is drawn again, in spans.
//!
//! At a pixel that is covered the depth lies between those of the vertices, which are at least
//! `culling::MARGIN` behind the near plane. A face has a plane only where the bound is below 1e-6 of the
//! determinant over w. So the depth's rounding is some 1e-5 at most, and no pixel need be held
//! against the near plane.

use bokashi_core::Scalar;

use super::culling::{Corner, are_tame};
use super::setup::{LANES, Weights, keep_nearer, lanes, plane};
use crate::homogeneous::edge;
use crate::order::{largest, least, smaller};
use crate::size::Size;

/// A face that is drawn in blocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct SmallFace<S> {
    /// The edge functions' coefficients, positive inside.
    edges: [[S; 3]; 3],
    /// The depth's coefficients.
    plane: [S; 3],
    /// At least the size below which the sign of an edge function is uncertain.
    error_bound: S,
}

impl<S: Scalar<Wide = S>> SmallFace<S> {
    /// Of a face of that orientation, 1 or -1; `None` where it has to be drawn in spans.
    #[inline(always)]
    pub(super) fn new(corners: [&Corner<S>; 3], orientation: i8, size: Size) -> Option<Self> {
        if !are_tame(corners) {
            return None;
        }
        let vertices = corners.map(|corner| corner.vertex);
        let sign = S::from_f64(f64::from(orientation));
        let [p, q, r] = vertices;
        let edges = [edge(q, r), edge(r, p), edge(p, q)];
        let edges = edges.map(|[e, ex, ey]| [sign * e, sign * ex, sign * ey]);
        let (w, [width, height]) = (largest([p.w, q.w, r.w]), size.extents::<S>());
        let error_bound = S::from_f64(65.0 * f64::EPSILON) * (width * w) * (height * w);
        let plane = plane(&vertices, &edges, error_bound)?;
        Some(Self { edges, plane, error_bound })
    }

    /// Draws the blocks of columns `centers` in the rows at `ys`, of which each has `per_row` blocks
    /// from its first on: where the depth is smaller than in `depths` it takes its place, and `face`
    /// that in `faces`. Returns whether some pixel is uncertain: none of these is drawn.
    #[inline(always)]
    pub(super) fn cover(
        &self,
        ys: &[S],
        centers: &[[S; LANES]],
        (depths, faces): (&mut [[S; LANES]], &mut [[u64; LANES]]),
        per_row: usize,
        face: u64,
    ) -> bool {
        let Self { edges: [a, b, c], plane, error_bound } = *self;
        let [ones, xs, by_ys] = [0, 1, 2].map(|k| [a[k], b[k], c[k], plane[k]]);
        let mut closest = [S::from_f64(f64::INFINITY); LANES];
        let mut first = 0;
        for &y in ys {
            let within = first..first + centers.len();
            first += per_row;
            let starts = lanes(|k| ones[k] + by_ys[k] * y);
            let pixels = depths[within.clone()].iter_mut().zip(&mut faces[within]);
            for ((nearest, nearest_face), x) in pixels.zip(centers) {
                let along = |k: usize| lanes(|lane| starts[k] + xs[k] * x[lane]);
                let [a, b, c, depth] = [along(0), along(1), along(2), along(3)];
                let inside = lanes(|k| least([a[k], b[k], c[k]]));
                let is_inside = lanes(|k| inside[k] > error_bound);
                keep_nearer((nearest, nearest_face), is_inside, depth, face);
                closest = lanes(|k| smaller(inside[k].abs(), closest[k]));
            }
        }
        closest.iter().any(|&distance| distance <= error_bound)
    }

    /// What is kept of the face once it is drawn and none of its pixels was uncertain.
    #[inline(always)]
    pub(super) fn weights(&self) -> Weights<S> {
        Weights { edges: self.edges, is_plain: true }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::culling::{Fate, Verdict};
    use super::super::setup::{Setup, beyond};
    use super::*;

    /// A face's setup, and what draws it in blocks if that can be; `None` where it is not drawn.
    fn prepared(clip: &[[f64; 4]; 3], size: Size) -> Option<(Setup<f64>, Option<SmallFace<f64>>)> {
        let corners = [0, 1, 2].map(|index| Corner::new(clip.as_flattened(), index, size));
        let corners = corners.each_ref();
        let Verdict { orientation, fate, .. } =
            Verdict::from_corners(corners, [0, 1, 2], size.into(), f64::INFINITY);
        let small = SmallFace::new(corners, orientation, size);
        matches!(fate, Fate::Drawn { .. }).then(|| (Setup::new(corners, orientation, size), small))
    }

    fn setup(clip: &[[f64; 4]; 3], size: Size) -> Option<Setup<f64>> {
        prepared(clip, size).map(|(setup, _)| setup)
    }

    /// Faces in view, some of which touch the near plane: of three vertices, or slivers with a vertex beside
    /// the line between the others.
    fn face_in_view() -> impl Strategy<Value = [[f64; 4]; 3]> {
        let depth = prop_oneof![-1.0..0.99_f64, -1.0..-0.9998_f64];
        let vertex = (-1.0..1.0_f64, -1.0..1.0_f64, depth, 0.1..4.0_f64)
            .prop_map(|(x, y, depth, w)| [w * x, w * y, w * depth, w]);
        let sliver = (vertex.clone(), vertex.clone(), 0.0..1.0_f64, -16.0..-1.0_f64).prop_map(
            |(p, q, along, digits)| {
                let r: [f64; 4] = std::array::from_fn(|k| p[k] + along * (q[k] - p[k]));
                [p, q, [r[0] + f64::powf(10.0, digits), r[1], r[2], r[3]]]
            },
        );
        prop_oneof![prop::array::uniform3(vertex), sliver]
    }

    /// Vertices before the eye, some near it, and some behind.
    fn vertex() -> impl Strategy<Value = [f64; 4]> {
        let w = prop_oneof![3 => 0.2..2.0_f32, 1 => -1.5..0.2_f32];
        let z = prop_oneof![3 => -0.9..0.9_f32, 1 => -3.0..3.0_f32];
        (-1.6..1.6_f32, -1.6..1.6_f32, z, w).prop_map(|(x, y, z, w)| [x, y, z, w].map(f64::from))
    }

    /// Faces of such vertices, and with corners on pixel centres.
    fn face() -> impl Strategy<Value = [[f64; 4]; 3]> {
        let on_centers = (0..16_u8, 0..16_u8, -0.9..0.9_f64).prop_map(|(x, y, z)| {
            [f64::from(x) / 8.0 - 0.9375, f64::from(y) / 8.0 - 0.9375, z, 1.0]
        });
        prop::array::uniform3(prop_oneof![vertex(), on_centers])
    }

    /// Depths and faces, in blocks.
    type Blocks = (Vec<[f64; LANES]>, Vec<[u64; LANES]>);

    /// Rows of blocks.
    fn rows_of<'a>(
        ys: &'a [f64],
        (depths, faces): &'a mut Blocks,
    ) -> impl Iterator<Item = (f64, &'a mut [[f64; LANES]], &'a mut [[u64; LANES]])> {
        let per_row = depths.len() / ys.len();
        let rows = depths.chunks_exact_mut(per_row).zip(faces.chunks_exact_mut(per_row));
        ys.iter().zip(rows).map(|(&y, (depths, faces))| (y, depths, faces))
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

        #[test]
        fn blocks_draw_what_spans_draw(
            faces in prop::array::uniform3(prop_oneof![face(), face_in_view()]),
            width in 1..22_usize,
            height in 1..17_usize,
            first in 0..17_usize,
        ) {
            // Blocks are drawn from row `first` on, and write beyond a width that they do not divide.
            let (size, first) = (Size { width, height }, first % height);
            let columns = size.width.next_multiple_of(LANES);
            let centers: Vec<f64> = (0..columns).map(|column| size.center_x(column)).collect();
            let (in_blocks, _) = centers.as_chunks();
            let ys: Vec<f64> = (first..size.height).map(|row| size.center_y(row)).collect();
            let count = ys.len() * in_blocks.len();
            let mut blocks = (vec![[beyond::<f64>(); LANES]; count], vec![[u64::MAX; LANES]; count]);
            let mut spans = blocks.clone();
            let in_spans = |setup: &mut Setup<f64>, pixels: &mut Blocks, face| {
                for (y, depths, faces) in rows_of(&ys, pixels) {
                    let (depths, faces) = (depths.as_flattened_mut(), faces.as_flattened_mut());
                    let (row, all) = (setup.row(y), [0, size.width]);
                    setup.cover_span(&row, all, &centers[..size.width], depths, faces, face);
                }
            };
            let prepared = faces.iter().filter_map(|face| prepared(face, size));
            for (face, (mut setup, small)) in (0..).zip(prepared) {
                let Some(small) = small else { continue };
                let (depths, seen) = &mut blocks;
                let is_uncertain = small.cover(&ys, in_blocks, (depths, seen), in_blocks.len(), face);
                in_spans(&mut setup, &mut spans, face);
                if is_uncertain {
                    in_spans(&mut setup, &mut blocks, face);
                } else {
                    let (weights, expected) = (small.weights(), setup.weights());
                    prop_assert_eq!((weights.edges, weights.is_plain), (expected.edges, expected.is_plain));
                }
            }
            // What lies in the padding means nothing.
            for ((_, blocks, seen), (_, spans, expected)) in
                rows_of(&ys, &mut blocks).zip(rows_of(&ys, &mut spans))
            {
                prop_assert_eq!(&blocks.as_flattened()[..width], &spans.as_flattened()[..width]);
                prop_assert_eq!(&seen.as_flattened()[..width], &expected.as_flattened()[..width]);
            }
        }
    }

    #[test]
    fn a_depth_is_linear_where_its_rounding_cannot_be_seen() {
        let size = Size::square(16);
        let has_plane = |clip: [[f64; 4]; 3]| setup(&clip, size).unwrap().has_plane();
        let face =
            |z: f64, w: f64| [[-0.7, -0.8, z, w], [0.8, -0.6, 0.3, 1.0], [0.1, 0.9, -0.4, 1.2]];
        assert!(has_plane(face(0.2, 1.0)) && has_plane(face(-900.0, 1.0)));
        // Vertex 0 behind the eye, in its plane, and too far away in depth.
        assert!(!has_plane(face(0.2, -0.1)) && !has_plane(face(0.2, 0.0)));
        assert!(!has_plane(face(1100.0, 1.0)) && !has_plane(face(-0.9, 1e-4)));
        let behind = face(0.2, -0.1);
        assert!(!has_plane([behind[1], behind[0], behind[2]]));
        assert!(!has_plane([behind[1], behind[2], behind[0]]));
        // Slivers of the law `a_sliver_is_seen_where_it_is_the_nearer_one`: among them are some of each kind.
        let sliver = |width: f64| {
            let [left, right, middle] = [-0.6875, 0.6875, 0.4375];
            let [low, high] = [middle - 0.125 * width, middle + 0.125 * width];
            [[left, high, 1.35, 1.0], [right, high, -0.45, 1.0], [right, low, -0.45, 1.0]]
        };
        assert!(has_plane(sliver(1e-4)));
        let thin = [1e-9, 1e-10, 3e-11, 1e-11].map(|width| setup(&sliver(width), size));
        let uncertain = thin.into_iter().flatten().filter(|setup| !setup.has_plane());
        assert!(uncertain.count() > 1);
    }
}
