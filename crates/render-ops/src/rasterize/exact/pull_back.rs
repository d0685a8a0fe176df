//! From the gradients of the pieces' areas and barycentrics to the gradients of the vertices.
//!
//! A piece of area A has the weight `A / 4`. What is gained along its sides changes its area and its
//! mean barycentrics (`mean`), and leads on to the lines that bound it (`polygon`).
//!
//! Lines are edge functions, or depths. A depth is `d = sum z_i a_i / D` per coefficient, with
//! `D = sum w_i a_i` the same number over the whole image. Then `a_bar_i = z_i d_bar / D` per
//! coefficient. `D_bar = -sum d d_bar / D` goes to the coefficient of 1, times w_i.
//! `z_bar_i = sum a_i d_bar / D`, and `w_bar_i = a_i D_bar` with the coefficient of 1.

use std::ops::Range;

use bokashi_core::Scalar;

use super::extent::Extent;
use super::mean::{self, Growth, GrowthOfMean};
use super::parts::{Side, Source};
use super::pieces::{Pieces, Segment};
use super::polygon::line_bar;
use crate::dispatch::dispatch_256;
use crate::edge_functions::{EdgeSums, LocalFace};
use crate::mesh::Mesh;
use crate::rasterize::corner::ClipVertices;
use crate::size::Size;

/// What the backward pass of a band reads.
pub(in crate::rasterize) struct PiecePullBack<'a, T: Scalar> {
    pub(in crate::rasterize) mesh: &'a Mesh,
    pub(in crate::rasterize) size: Size,
    pub(in crate::rasterize) corners: ClipVertices<'a, T>,
    /// The faces that were drawn in the band.
    pub(in crate::rasterize) faces: &'a [u32],
    pub(in crate::rasterize) pieces: &'a Pieces<T::Wide>,
    /// Per piece, pixel by pixel: its fragment, counted from the band's first.
    pub(in crate::rasterize) fragments: &'a [u32],
    /// The gradients `[N, 2]` of the barycentrics and `[N]` of the weights of the band's fragments,
    /// where there are any.
    pub(in crate::rasterize) barycentrics_bar: Option<&'a [T]>,
    pub(in crate::rasterize) weights_bar: Option<&'a [T]>,
}

/// The gradients of a face's edge functions and of its depth's coefficients, around one of its pixels.
#[derive(Debug)]
struct Adjoint<S> {
    band_face: u32,
    sign: S,
    face: LocalFace<S>,
    edges: EdgeSums<S>,
    depth: [S; 3],
}

/// The adjoints of a band's faces.
#[derive(Debug, Default)]
pub(in crate::rasterize) struct Adjoints<S> {
    adjoints: Vec<Adjoint<S>>,
    /// Per face of the band: its adjoint.
    of_band_face: Vec<u32>,
    /// Per piece of a pixel.
    growths: Vec<Growth<S>>,
    /// The faces with the gradients of their vertices, where they are added later.
    pub(in crate::rasterize) rows: Vec<(usize, [[S; 4]; 3])>,
}

/// Stands for "no adjoint".
const NONE: u32 = u32::MAX;

impl<S: Scalar<Wide = S>> Adjoint<S> {
    /// Of a face of the band, around `pixel`.
    #[inline(never)]
    fn new<T: Scalar<Wide = S>>(band: &PiecePullBack<'_, T>, band_face: u32, pixel: usize) -> Self {
        let indices = band.mesh.faces()[band.faces[band_face as usize] as usize];
        let corners = band.corners.corners_of(indices);
        let vertices = corners.map(|corner| corner.vertex);
        let factors = corners.map(|corner| corner.factor);
        let face = LocalFace::new(vertices, factors, pixel, band.size);
        let sign = if face.determinant() > S::ZERO { S::ONE } else { -S::ONE };
        let (edges, depth) = (EdgeSums::default(), [S::ZERO; 3]);
        Self { band_face, sign, face, edges, depth }
    }

    /// Adds the gradient of the coefficients, around `offset` from the origin, of the edge function
    /// that faces corner k.
    #[inline(always)]
    fn add_edge(&mut self, k: usize, [one, x, y]: [S; 3], offset: [S; 2]) {
        // The value at `offset` is that at the origin plus `x offset_x + y offset_y`: so its gradient goes on to
        // the slopes.
        let one = self.sign * one;
        self.edges.ones[k] += one;
        self.edges.xs[k] += self.sign * x + offset[0] * one;
        self.edges.ys[k] += self.sign * y + offset[1] * one;
    }

    /// The same of the depth.
    #[inline(always)]
    fn add_depth(&mut self, sign: S, [one, x, y]: [S; 3], offset: [S; 2]) {
        let one = sign * one;
        self.depth[0] += one;
        self.depth[1] += sign * x + offset[0] * one;
        self.depth[2] += sign * y + offset[1] * one;
    }

    /// The gradients of the vertices, `[3, 4]`.
    fn rows(mut self, size: Size) -> [[S; 4]; 3] {
        let coefficients = *self.face.coefficients();
        let mut direct = [[S::ZERO; 2]; 3];
        if !are_zero(self.depth) {
            let vertices = self.face.vertices;
            let total = self.face.determinant();
            let bar = self.depth.map(|bar| bar / total);
            let depth = |c: usize| -> S {
                (0..3).map(|i| vertices[i].z * coefficients[i][c]).sum::<S>() / total
            };
            let total_bar = -(0..3).map(|c| bar[c] * depth(c)).sum::<S>();
            for i in 0..3 {
                let z = vertices[i].z;
                self.edges.ones[i] += z * bar[0] + total_bar * vertices[i].w;
                self.edges.xs[i] += z * bar[1];
                self.edges.ys[i] += z * bar[2];
                let z_bar = (0..3).map(|c| bar[c] * coefficients[i][c]).sum();
                direct[i] = [z_bar, total_bar * coefficients[i][0]];
            }
        }
        std::array::from_fn(|i| {
            let [x_bar, y_bar, w_bar] = self.face.pull_back(&self.edges, i, size);
            let [z_bar, more] = direct[i];
            [x_bar, y_bar, z_bar, w_bar + more].map(|bar| self.face.factors[i] * bar)
        })
    }
}

impl<S: Scalar<Wide = S>> Adjoints<S> {
    /// Sums over the pieces of a band, and calls `emit` with each face and the gradients of its
    /// vertices.
    pub(in crate::rasterize) fn sum<T: Scalar<Wide = S>>(
        &mut self,
        band: &PiecePullBack<'_, T>,
        mut emit: impl FnMut(usize, &[[S; 4]; 3]),
    ) {
        self.of_band_face.clear();
        self.of_band_face.resize(band.faces.len(), NONE);
        self.adjoints.clear();
        let pieces = band.pieces;
        let (mut first, mut first_segment) = (0, 0);
        let of_pixels = pieces.pixels.iter().zip(&pieces.ends).zip(&pieces.segment_ends);
        dispatch_256::<T, _>(
            #[inline(always)]
            || {
                for ((&pixel, &end), &segment_end) in of_pixels {
                    let range = first..end as usize;
                    let segments = &pieces.segments[first_segment..segment_end as usize];
                    (first, first_segment) = (range.end, segment_end as usize);
                    self.sum_pixel(band, pixel as usize, range, segments);
                }
            },
        );
        for adjoint in self.adjoints.drain(..) {
            let face = band.faces[adjoint.band_face as usize] as usize;
            emit(face, &adjoint.rows(band.size));
        }
    }

    /// [`Adjoints::sum`] into `rows`.
    pub(in crate::rasterize) fn keep<T: Scalar<Wide = S>>(&mut self, band: &PiecePullBack<'_, T>) {
        let mut rows = std::mem::take(&mut self.rows);
        rows.clear();
        self.sum(band, |face, row| rows.push((face, *row)));
        self.rows = rows;
    }

    #[inline(always)]
    fn sum_pixel<T: Scalar<Wide = S>>(
        &mut self,
        band: &PiecePullBack<'_, T>,
        pixel: usize,
        pieces: Range<usize>,
        segments: &[Segment<S>],
    ) {
        let mut growths = std::mem::take(&mut self.growths);
        growths.clear();
        let center = band.size.center::<S>(pixel);
        for (piece, &fragment) in
            band.pieces.pieces[pieces.clone()].iter().zip(&band.fragments[pieces])
        {
            let fragment = fragment as usize;
            let weight_bar = band.weights_bar.map_or(S::ZERO, |bars| bars[fragment].widen());
            // The weight is A / 4.
            let area_bar = S::from_f64(0.25) * weight_bar;
            let mut of_mean = None;
            if let Some(bars) = band.barycentrics_bar {
                let uv_bar = [bars[2 * fragment], bars[2 * fragment + 1]].map(T::widen);
                let adjoint = self.adjoint(band, piece.band_face, pixel);
                let offset = adjoint.face.offset_of(center);
                let growth = adjoint.add_barycentrics(uv_bar, &piece.extent, offset);
                of_mean = piece.moves.then_some(growth);
            }
            growths.push(Growth { area: piece.area, area_bar, of_mean });
        }
        // Each side: worth per unit of area along it, then the line that it lies on, then that line's source.
        for segment in segments {
            let Side { source, normal, ends, .. } = segment.side;
            let integrals = growths[segment.piece as usize].along(ends);
            let line_bar = line_bar(ends, segment.side.share(), normal, integrals);
            if are_zero(line_bar) {
                continue;
            }
            let mut add_depth = |band_face: u32, sign: S| {
                let adjoint = self.adjoint(band, band_face, pixel);
                let offset = adjoint.face.offset_of(center);
                adjoint.add_depth(sign, line_bar, offset);
            };
            match source {
                Source::Edge { band_face, k } => {
                    let adjoint = self.adjoint(band, band_face, pixel);
                    let offset = adjoint.face.offset_of(center);
                    adjoint.add_edge(k as usize, line_bar, offset);
                }
                Source::End { band_face, is_far } => {
                    add_depth(band_face, if is_far { -S::ONE } else { S::ONE });
                }
                // The line is the depth of the second minus that of the first.
                Source::Between { first, second } => {
                    add_depth(second, S::ONE);
                    add_depth(first, -S::ONE);
                }
            }
        }
        self.growths = growths;
    }

    /// The adjoint of a face, around `pixel` where that is the first pixel to ask.
    #[inline(always)]
    fn adjoint<T: Scalar<Wide = S>>(
        &mut self,
        band: &PiecePullBack<'_, T>,
        band_face: u32,
        pixel: usize,
    ) -> &mut Adjoint<S> {
        let Self { adjoints, of_band_face, .. } = self;
        let index = &mut of_band_face[band_face as usize];
        if *index == NONE {
            *index = adjoints.len() as u32;
            adjoints.push(Adjoint::new(band, band_face, pixel));
        }
        &mut adjoints[*index as usize]
    }
}

impl<S: Scalar<Wide = S>> Adjoint<S> {
    /// Adds what the gradients of u and v of a piece, whose pixel's centre lies at `offset`, say of the
    /// edge functions; returns what they say of its sides.
    #[inline(always)]
    fn add_barycentrics(
        &mut self,
        uv_bar: [S; 2],
        extent: &Extent<S>,
        offset: [S; 2],
    ) -> GrowthOfMean<S> {
        let [x, y] = [0, 1].map(|axis| offset[axis] + extent.centroid[axis]);
        let lines = self.face.coefficients();
        let around =
            lines.map(|[one, by_x, by_y]| [one + by_x * offset[0] + by_y * offset[1], by_x, by_y]);
        let bars = mean::adjoint(&around, self.face.factors, extent, uv_bar);
        for i in 0..3 {
            self.edges.ones[i] += bars.values[i];
            self.edges.xs[i] += x * bars.values[i] + bars.slopes[i][0];
            self.edges.ys[i] += y * bars.values[i] + bars.slopes[i][1];
        }
        bars.growth
    }
}

/// Whether nothing can come of these numbers, and nothing of their derivatives either.
fn are_zero<S: Scalar>(numbers: [S; 3]) -> bool {
    numbers.iter().all(|number| number.is_same(S::ZERO))
}
