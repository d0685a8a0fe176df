//! Quotients of two functions that are linear over the image, at fragments: what depths are.
//!
//! # Forward
//! Let a face's vertices have the numbers n_i and m_i. At a pixel's centre, with the face's edge functions
//! a_i, the quotient is `q = N / M`, `N = sum n_i a_i`, `M = sum m_i a_i`. In [`Scalar::Wide`].
//!
//! # Backward
//! `a_bar_i = q_bar (n_i - q m_i) / M`, from there as in `edge_functions`; and `n_bar_i += q_bar a_i / M`,
//! `m_bar_i -= q_bar q a_i / M`. Terms beyond the range of the numbers are treated as in
//! [`rasterize`](crate::rasterize()).
//!
//! A piece of a boundary pixel has the quotient of its mean weights b_i, which depend on the vertices:
//! `N = sum b_i n_i`, `M = sum b_i m_i`; `b_bar_i = q_bar (n_i - q m_i) / M`, `n_bar_i += q_bar b_i / M`,
//! `m_bar_i -= q_bar q b_i / M`.

use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::coverage::Coverage;
use crate::edge_functions::{EdgeSums, LocalFace};
use crate::error::RenderError;
use crate::face_sums::{FaceSums, Layout, add_term};
use crate::fragments::Fragments;
use crate::homogeneous::Vertex;
use crate::runs::Run;
use crate::scratch::Workbench;

/// Which quotient it is.
pub(crate) trait Quotient: Send + Sync + 'static {
    /// The operation's name.
    const NAME: &'static str;

    /// n and m of a vertex that was multiplied by `factor`.
    fn terms<S: Scalar>(vertex: &Vertex<S>, factor: S) -> [S; 2];

    /// The gradients of z and w from those of n and m.
    fn pull_back<S: Scalar>(bars: [S; 2]) -> [S; 2];

    /// The quotient within the range that it can have.
    fn within_range<S: Scalar>(quotient: S) -> S;
}

/// The quotient at each fragment, `[N]`.
///
/// # Errors
/// [`RenderError::Shape`] for fragments that are not whole; `TensorError::ForeignVariable` for
/// fragments of several tapes.
pub(crate) fn quotients<'t, T: Scalar, Q: Quotient>(
    fragments: &Fragments<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let tape = fragments.clip.tape();
    let coverage = fragments.checked_coverage(Q::NAME, tape)?;
    let inputs = [fragments.clip, fragments.barycentrics];
    let count = if coverage.is_exact() { 2 } else { 1 };
    tape.apply(OfFragments::<Q> { coverage, quotient: PhantomData }, &inputs[..count])
}

/// Inputs: clip `[V, 4]`, and with exact coverage barycentrics `[N, 2]`. Output: quotients `[N]`.
struct OfFragments<Q> {
    coverage: Arc<Coverage>,
    quotient: PhantomData<Q>,
}

/// The face of slot `slot` around the slot's first pixel, and n and m of its vertices.
fn face_of<T: Scalar, Q: Quotient>(
    coverage: &Coverage,
    clip: &[T],
    slot: usize,
) -> (LocalFace<T::Wide>, [[T::Wide; 2]; 3]) {
    let runs = &coverage.centers;
    let indices = coverage.mesh.faces()[runs.face(slot)];
    let face = LocalFace::at_pixel(clip, indices, runs.first_pixel_of(slot), coverage.size);
    let terms = std::array::from_fn(|i| Q::terms(&face.vertices[i], face.factors[i]));
    (face, terms)
}

/// The quotient, and M, where weights or edge functions are `a`.
#[inline(always)]
fn quotient<S: Scalar>([p, q, r]: &[[S; 2]; 3], a: [S; 3]) -> [S; 2] {
    let m = p[1] * a[0] + q[1] * a[1] + r[1] * a[2];
    [(p[0] * a[0] + q[0] * a[1] + r[0] * a[2]) / m, m]
}

impl<T: Scalar, Q: Quotient> Op<T> for OfFragments<Q> {
    /// Memory for sums over faces.
    type Saved = Workbench<Vec<T>>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        Q::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _rows: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (coverage, clip) = (&*self.coverage, inputs.data(0));
        let values = outputs.push([coverage.count()]);
        let two = T::Wide::from_f64(2.0);
        let (values, pieces) = values.split_at_mut(coverage.centers());
        if inputs.len() == 2 {
            for (run, piece) in coverage.pieces.runs.iter().zip(pieces) {
                let Mean { quotient, .. } = Mean::new::<T, Q>(coverage, clip, inputs.data(1), run);
                *piece = T::narrow(Q::within_range(quotient));
            }
        }
        coverage.centers.for_each_band_mut(1, values, |slots, first, values| {
            for slot in slots {
                let (face, terms) = face_of::<T, Q>(coverage, clip, slot);
                for run in coverage.centers.in_slot(slot) {
                    let [mut x, y] = face.center_offset(run.pixel as usize, coverage.size);
                    let row = face.row(y);
                    let range = run.fragments().start - first..run.fragments().end - first;
                    for value in &mut values[range] {
                        let a = row.map(|[start, slope]| start + slope * x);
                        let [ratio, _] = quotient(&terms, a);
                        *value = T::narrow(Q::within_range(ratio));
                        x += two;
                    }
                }
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input_if(1, inputs.len() == 2)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        rows: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let (coverage, clip, bars) = (&*self.coverage, kept.input(0), kept.only_upstream());
        let pieces = |barycentrics| {
            let mean = move |run: &Run| {
                let fragment = coverage.centers() + run.fragment as usize;
                (
                    Mean::new::<T, Q>(coverage, clip, barycentrics, run),
                    bars[fragment].widen(),
                    fragment,
                )
            };
            coverage.pieces.runs.iter().map(mean)
        };
        if let Some(clip_bar) = gradients.get(0) {
            let pull_back = PullBack::<T, Q> { coverage, clip, bars, quotient: PhantomData };
            let runs = &coverage.centers;
            Layout { runs, mesh: &coverage.mesh, width: 4 }.add_to(clip_bar, &pull_back, rows);
            if kept.input_count() == 2 {
                let entries = clip_bar.entries();
                for (mean, bar, _) in pieces(kept.input(1)) {
                    let Mean { indices, weights, quotient, m, .. } = mean;
                    for (index, weight) in indices.into_iter().zip(weights) {
                        let n_bar = bar * weight / m;
                        let [z_bar, w_bar] = Q::pull_back([n_bar, -quotient * n_bar]);
                        let entries = &mut entries[4 * index as usize..][..4];
                        add_term(&mut entries[2], T::narrow(z_bar));
                        add_term(&mut entries[3], T::narrow(w_bar));
                    }
                }
            }
        }
        if kept.input_count() < 2 {
            return;
        }
        let Some(barycentrics_bar) = gradients.get(1) else { return };
        let entries = barycentrics_bar.entries();
        for (mean, bar, fragment) in pieces(kept.input(1)) {
            let [u_bar, v_bar] = mean.slopes().map(|slope| T::narrow(bar * slope));
            entries[2 * fragment] += u_bar;
            entries[2 * fragment + 1] += v_bar;
        }
    }

    fn saved_bytes(&self, rows: &Self::Saved) -> usize {
        rows.bytes()
    }
}

/// Where a piece has its mean weights.
struct Mean<S> {
    indices: [u32; 3],
    /// The weights of the face's vertices.
    weights: [S; 3],
    /// n and m of the vertices.
    terms: [[S; 2]; 3],
    quotient: S,
    /// `sum b_i m_i`.
    m: S,
}

impl<S: Scalar<Wide = S>> Mean<S> {
    fn new<T: Scalar<Wide = S>, Q: Quotient>(
        coverage: &Coverage,
        clip: &[T],
        barycentrics: &[T],
        piece: &Run,
    ) -> Self {
        let indices = coverage.mesh.faces()[coverage.pieces.face_of(piece)];
        let fragment = coverage.centers() + piece.fragment as usize;
        let [u, v] = [0, 1].map(|k| barycentrics[2 * fragment + k].widen());
        let weights = [u, v, S::ONE - u - v];
        let terms = indices.map(|index| {
            let [x, y, z, w] = std::array::from_fn(|k| clip[4 * index as usize + k].widen());
            Q::terms(&Vertex { x, y, z, w }, S::ONE)
        });
        let [n, m] = [0, 1].map(|k| (0..3).map(|i| weights[i] * terms[i][k]).sum::<S>());
        Self { indices, weights, terms, quotient: n / m, m }
    }

    /// The derivatives of the quotient with respect to u and v.
    fn slopes(&self) -> [S; 2] {
        let slopes = self.terms.map(|[n, m]| (n - self.quotient * m) / self.m);
        [slopes[0] - slopes[2], slopes[1] - slopes[2]]
    }
}

/// From the gradients of quotients to those of the vertices.
struct PullBack<'a, T, Q> {
    coverage: &'a Coverage,
    clip: &'a [T],
    bars: &'a [T],
    quotient: PhantomData<Q>,
}

impl<T: Scalar, Q: Quotient> FaceSums<T::Wide> for PullBack<'_, T, Q> {
    const WIDTH: Option<usize> = Some(4);

    type Memory = ();

    fn memory(&self) {}

    fn sum(&self, (): &mut (), slot: usize, fragments: Range<usize>, rows: &mut [T::Wide]) {
        let (face, terms) = face_of::<T, Q>(self.coverage, self.clip, slot);
        let size = self.coverage.size;
        let (mut edges, mut direct) = (EdgeSums::default(), [[T::Wide::ZERO; 2]; 3]);
        let two = T::Wide::from_f64(2.0);
        for run in self.coverage.centers.within(slot, fragments) {
            let [mut x, y] = face.center_offset(run.pixel as usize, size);
            let row = face.row(y);
            for bar in &self.bars[run.fragments()] {
                let a = row.map(|[start, slope]| start + slope * x);
                let [ratio, m] = quotient(&terms, a);
                let scale = bar.widen() / m;
                let a_bar = terms.map(|[n, m]| scale * (n - ratio * m));
                edges.add_row(a_bar, a_bar.map(|a_bar| x * a_bar), y);
                for (direct, a) in direct.iter_mut().zip(a) {
                    direct[0] += scale * a;
                    direct[1] -= scale * ratio * a;
                }
                x += two;
            }
        }
        for (i, row) in rows.chunks_exact_mut(4).enumerate() {
            let [x_bar, y_bar, w_bar] = face.pull_back(&edges, i, size);
            let [z_bar, more_w_bar] = Q::pull_back(direct[i]);
            let bars = [x_bar, y_bar, z_bar, w_bar + more_w_bar];
            row.copy_from_slice(&bars.map(|bar| face.factors[i] * bar));
        }
    }
}
