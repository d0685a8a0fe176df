//! Vertices `[V, 3]` of a mesh: their positions, and sums of gradients at each of them.

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Accumulator, Inputs, Scalar, TensorError};

use crate::topology::Topology;

/// A vector.
pub(super) type Vector<S> = [S; 3];

/// Vertices, edges or faces in one piece of work.
pub(super) const PER_PIECE: usize = 1 << 11;

/// Checks that input 0 has the positions of the vertices of `topology`.
pub(super) fn check<T: Scalar>(
    operation: &'static str,
    inputs: &Inputs<'_, T>,
    topology: &Topology,
) -> Result<(), TensorError> {
    let (shape, count) = (inputs.shape(0), topology.vertex_count());
    if **shape == [count, 3] {
        return Ok(());
    }
    let rule = format!("positions of shape [{count}, 3]").into();
    Err(TensorError::Shape { operation, rule, shape: shape.clone() })
}

/// The position of a vertex.
#[inline(always)]
pub(super) fn position<T: Scalar>(positions: &[T], vertex: u32) -> Vector<T::Wide> {
    let start = 3 * vertex as usize;
    [positions[start], positions[start + 1], positions[start + 2]].map(Scalar::widen)
}

#[inline(always)]
pub(super) fn minus<S: Scalar>(a: Vector<S>, b: Vector<S>) -> Vector<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn plus<S: Scalar>(a: Vector<S>, b: Vector<S>) -> Vector<S> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(super) fn dot<S: Scalar>(a: Vector<S>, b: Vector<S>) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn cross<S: Scalar>(a: Vector<S>, b: Vector<S>) -> Vector<S> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Adds `term(vertex)` to each row of a gradient `[V, 3]`.
pub(super) fn add_by_vertex<T: Scalar>(
    bar: &mut Accumulator<T>,
    term: impl Fn(usize) -> Vector<T::Wide> + Send + Sync,
) {
    let (bar, fresh) = bar.entries_or_fresh();
    for_each_piece_mut(bar, 3 * PER_PIECE, |piece, bar| {
        for (k, row) in bar.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            for (bar, term) in row.iter_mut().zip(term(piece * PER_PIECE + k)) {
                let term = T::narrow(term);
                *bar = if fresh { term } else { *bar + term };
            }
        }
    });
}
