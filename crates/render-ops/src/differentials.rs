//! How barycentrics change from pixel to pixel.
//!
//! # Forward
//! With the vertices `V_i = (x_i, y_i, w_i)` as the columns of M, let `F_i` be the rows of `M^-1`:
//! `F_i = E_i / D`, the coefficients of edge function i over the determinant. The weights `b_i` at a
//! point `p = (X, Y, 1)` are `W F_i p`, with `1 / W = sum_j F_j p`. So along `k = X, Y`, with
//! `T_k = sum_j F_jk`:
//!
//! `db_i/dk = W (F_ik - b_i T_k)`.
//!
//! A pixel is two units wide and Y runs up: `d/dx = 2 d/dX`, `d/dy = -2 d/dY`. A piece of a boundary
//! pixel has the derivatives where the weights are its means: there `W = sum_j b_j w_j`. At a pixel's
//! centre that sum would lose digits where the depths of the vertices differ much. In [`Scalar::Wide`].
//!
//! # Backward
//! Let `q_ik` be the gradients of `db_i/dk` (`q_2k = 0`), `m_k = sum_j q_jk b_j`, and
//! `W_bar = sum_ik q_ik (F_ik - b_i T_k)`. Then `b_bar_j = -W sum_k q_jk T_k`, and
//! `F_bar_jk = W (q_jk - m_k)`. Since `dM^-1 = -M^-1 dM M^-1`, the vertices get
//! `V_bar_i = -sum_j (sum_k F_bar_jk F_ik) F_j`. To that W adds `V_bar_i += W W_bar b_i sum_j F_j` at a
//! centre, and `w_bar_i += W_bar b_i`, `b_bar_i += W_bar w_i` for a piece. So sums over the fragments of
//! a face of `F_bar_jk` and of `W_bar b_i` are enough.
//!
//! # Where it is not smooth
//! Where the visible face changes.
//!
//! # Source
//! Edge functions as in `homogeneous`; the derivation is ours. Heckbert, *Fundamentals of texture
//! mapping and image warping*, 1989, section 3.5.1, has the same derivatives by the quotient rule.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::coverage::Coverage;
use crate::edge_functions::LocalFace;
use crate::error::RenderError;
use crate::face_sums::{FaceSums, Layout};
use crate::fragments::Fragments;
use crate::runs::Runs;
use crate::scratch::Workbench;
use crate::size::Size;

/// How the barycentrics of each fragment change from pixel to pixel: `[N, 2, 2]`, with du/dx, du/dy,
/// dv/dx and dv/dy, per pixel, x to the right and y **down**. Differentiable with respect to the
/// barycentrics and to the clip positions that were rasterized.
///
/// Textures choose their level of detail by them: see
/// [`interpolate_differentials`](crate::interpolate_differentials()).
///
/// # Errors
/// [`RenderError::Shape`] for fragments that are not whole; `TensorError::ForeignVariable` for
/// fragments of several tapes.
#[inline(never)]
pub fn differentials<'t, T: Scalar>(
    fragments: &Fragments<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let tape = fragments.clip.tape();
    let coverage = fragments.checked_coverage("differentials", tape)?;
    tape.apply(Differentials { coverage }, &[fragments.clip, fragments.barycentrics])
}

/// Inputs: clip `[V, 4]`, barycentrics `[N, 2]`. Output: `[N, 2, 2]`.
struct Differentials {
    coverage: Arc<Coverage>,
}

/// What all fragments of a face share.
struct Plane<S> {
    face: LocalFace<S>,
    /// `F_ik`, for the three vertices along X and Y.
    slopes: [[S; 2]; 3],
    /// `F_2 p` at the face's origin.
    last: S,
    /// `1 / W` at the face's origin, and `T_k`.
    sums: [S; 3],
    /// The vertices' w in clip space.
    w: [S; 3],
    /// Whether its fragments are pieces of boundary pixels.
    is_of_pieces: bool,
}

/// X is two units per pixel to the right, and Y two units per pixel up.
const UNITS_PER_PIXEL: [f64; 2] = [2.0, -2.0];

/// The three weights, and W.
type Weights<S> = ([S; 3], S);

impl<S: Scalar<Wide = S>> Plane<S> {
    #[inline(always)]
    fn new<T: Scalar<Wide = S>>(coverage: &Coverage, clip: &[T], runs: &Runs, slot: usize) -> Self {
        let indices = coverage.mesh.faces()[runs.face(slot)];
        let face = LocalFace::at_pixel(clip, indices, runs.first_pixel_of(slot), coverage.size);
        let w = indices.map(|index| clip[4 * index as usize + 3].widen());
        let scale = S::ONE / face.determinant();
        let rows: [[S; 3]; 3] = std::array::from_fn(|i| {
            face.coefficients()[i].map(|coefficient| face.factors[i] * (coefficient * scale))
        });
        let sums = [0, 1, 2].map(|k| rows[0][k] + rows[1][k] + rows[2][k]);
        let slopes = rows.map(|[_, x, y]| [x, y]);
        let is_of_pieces = std::ptr::eq(runs, &coverage.pieces);
        Self { face, slopes, last: rows[2][0], sums, w, is_of_pieces }
    }

    /// Calls `visit(k, weights)` for the k-th of `fragments` of the face, which are those of `runs`.
    #[inline(always)]
    fn for_each<T: Scalar<Wide = S>>(
        &self,
        size: Size,
        (runs, slot): (&Runs, usize),
        fragments: Range<usize>,
        uv: &[[T; 2]],
        mut visit: impl FnMut(usize, Weights<S>),
    ) {
        if self.is_of_pieces {
            for (k, uv) in uv.iter().enumerate() {
                let [u, v] = uv.map(T::widen);
                let w = self.w[2] + u * (self.w[0] - self.w[2]) + v * (self.w[1] - self.w[2]);
                visit(k, ([u, v, S::ONE - u - v], w));
            }
            return;
        }
        let two = S::from_f64(2.0);
        let mut k = 0;
        for run in runs.within(slot, fragments) {
            let [mut x, y] = self.face.center_offset(run.pixel as usize, size);
            let start = self.sums[0] + self.sums[2] * y;
            let last = self.last + self.slopes[2][1] * y;
            for uv in &uv[k..k + run.length as usize] {
                let [u, v] = uv.map(T::widen);
                let w = S::ONE / (start + self.sums[1] * x);
                // Not 1 - u - v, which has few digits where vertex 2 is far behind the others.
                visit(k, ([u, v, w * (last + self.slopes[2][0] * x)], w));
                x += two;
                k += 1;
            }
        }
    }

    /// `F_ik - b_i T_k` for vertices 0 and 1.
    #[inline(always)]
    fn slopes_at(&self, [u, v, _]: [S; 3]) -> [[S; 2]; 2] {
        let slope = |i: usize, b: S| [0, 1].map(|k| self.slopes[i][k] - b * self.sums[k + 1]);
        [slope(0, u), slope(1, v)]
    }
}

/// `q_ik` of vertices 0 and 1, from the gradients of a fragment's derivatives.
#[inline(always)]
fn upstream<T: Scalar>(bars: &[T; 4]) -> [[T::Wide; 2]; 2] {
    let [x, y] = UNITS_PER_PIXEL.map(T::Wide::from_f64);
    let [ux, uy, vx, vy] = bars.map(T::widen);
    [[x * ux, y * uy], [x * vx, y * vy]]
}

/// The sum of the products of all entries.
#[inline(always)]
fn dot<S: Scalar>(a: [[S; 2]; 2], b: [[S; 2]; 2]) -> S {
    a[0][0] * b[0][0] + a[0][1] * b[0][1] + a[1][0] * b[1][0] + a[1][1] * b[1][1]
}

impl<T: Scalar> Op<T> for Differentials {
    /// Memory for sums over faces.
    type Saved = Workbench<Vec<T>>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "differentials"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _rows: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (coverage, clip, uv) = (&*self.coverage, inputs.data(0), inputs.data(1));
        let uv = uv.as_chunks::<2>().0;
        let out = outputs.push([coverage.count(), 2, 2]);
        let [x, y] = UNITS_PER_PIXEL.map(T::Wide::from_f64);
        coverage.for_each_slot_mut(
            out,
            #[inline(always)]
            |runs, slot, fragments, entries| {
                let plane = Plane::new(coverage, clip, runs, slot);
                let (out, uv) = (entries.as_chunks_mut::<4>().0, &uv[fragments]);
                let fragments = runs.fragments_of(slot..slot + 1);
                plane.for_each(coverage.size, (runs, slot), fragments, uv, |k, (b, w)| {
                    let [u, v] = plane.slopes_at(b);
                    out[k] = [x * u[0], y * u[1], x * v[0], y * v[1]].map(|s| T::narrow(w * s));
                });
            },
        );
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        rows: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let (coverage, clip) = (&*self.coverage, kept.input(0));
        let uv = kept.input(1).as_chunks::<2>().0;
        let bars = kept.only_upstream().as_chunks::<4>().0;
        if let Some(clip_bar) = gradients.get(0) {
            for (runs, first) in coverage.kinds() {
                let pull_back =
                    PullBack { coverage, runs, clip, uv: &uv[first..], bars: &bars[first..] };
                Layout { runs, mesh: &coverage.mesh, width: 4 }.add_to(clip_bar, &pull_back, rows);
            }
        }
        if let Some(uv_bar) = gradients.get(1) {
            let (entries, is_fresh) = uv_bar.entries_or_fresh();
            coverage.for_each_slot_mut(
                entries,
                #[inline(always)]
                |runs, slot, fragments, entries| {
                    let plane = Plane::new(coverage, clip, runs, slot);
                    let (entries, uv) = (entries.as_chunks_mut::<2>().0, &uv[fragments.clone()]);
                    let (bars, fragments) = (&bars[fragments], runs.fragments_of(slot..slot + 1));
                    plane.for_each(coverage.size, (runs, slot), fragments, uv, |k, (b, w)| {
                        let q = upstream(&bars[k]);
                        let mut bar = q.map(|q| -w * (q[0] * plane.sums[1] + q[1] * plane.sums[2]));
                        if plane.is_of_pieces {
                            let w_bar = dot(q, plane.slopes_at(b));
                            for (j, bar) in bar.iter_mut().enumerate() {
                                *bar += w_bar * (plane.w[j] - plane.w[2]);
                            }
                        }
                        let bar = bar.map(T::narrow);
                        let entry = &mut entries[k];
                        *entry =
                            if is_fresh { bar } else { [entry[0] + bar[0], entry[1] + bar[1]] };
                    });
                },
            );
        }
    }

    fn saved_bytes(&self, rows: &Self::Saved) -> usize {
        rows.bytes()
    }
}

/// From the gradients of the derivatives to those of the vertices.
struct PullBack<'a, T> {
    coverage: &'a Coverage,
    runs: &'a Runs,
    clip: &'a [T],
    /// Of the fragments of `runs`.
    uv: &'a [[T; 2]],
    bars: &'a [[T; 4]],
}

impl<T: Scalar> FaceSums<T::Wide> for PullBack<'_, T> {
    const WIDTH: Option<usize> = Some(4);

    type Memory = ();

    fn memory(&self) {}

    #[inline(always)]
    fn sum(&self, (): &mut (), slot: usize, fragments: Range<usize>, rows: &mut [T::Wide]) {
        let Self { coverage, runs, clip, .. } = *self;
        let plane = Plane::new(coverage, clip, runs, slot);
        // Of `F_bar_jk`, and of `W_bar b_i`: times W at centres.
        let (mut slopes_bar, mut w_bars) = ([[T::Wide::ZERO; 2]; 3], [T::Wide::ZERO; 3]);
        let (uv, bars) = (&self.uv[fragments.clone()], &self.bars[fragments.clone()]);
        plane.for_each(coverage.size, (runs, slot), fragments, uv, |k, (b, w)| {
            let q = upstream(&bars[k]);
            let w_bar = dot(q, plane.slopes_at(b));
            let w_bar = if plane.is_of_pieces { w_bar } else { w * w_bar };
            for (sum, b) in w_bars.iter_mut().zip(b) {
                *sum += w_bar * b;
            }
            for k in 0..2 {
                let m = q[0][k] * b[0] + q[1][k] * b[1];
                slopes_bar[0][k] += w * (q[0][k] - m);
                slopes_bar[1][k] += w * (q[1][k] - m);
                slopes_bar[2][k] += w * -m;
            }
        });
        let scale = -T::Wide::ONE / plane.face.determinant();
        for (i, row) in rows.chunks_exact_mut(4).enumerate() {
            let by_w = if plane.is_of_pieces { T::Wide::ZERO } else { w_bars[i] };
            let edge_bar = |j: usize| {
                let along = slopes_bar[j][0] * plane.slopes[i][0];
                along + slopes_bar[j][1] * plane.slopes[i][1] - by_w
            };
            let along =
                plane.face.along_edges([edge_bar(0), edge_bar(1), edge_bar(2)], coverage.size);
            let [x_bar, y_bar, w_bar] = along.map(|bar| scale * bar);
            let direct = if plane.is_of_pieces { w_bars[i] } else { T::Wide::ZERO };
            row.copy_from_slice(&[x_bar, y_bar, T::Wide::ZERO, w_bar + direct]);
        }
    }
}
