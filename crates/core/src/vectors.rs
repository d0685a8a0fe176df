//! Vectors along the last axes of arrays whose other axes broadcast.

use crate::error::TensorError;
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use crate::shape::Shape;
use crate::walk::{Walk, axes};

/// The number of components of vectors along the last axis of `shape`.
///
/// # Errors
/// [`TensorError::Shape`] for a scalar.
pub(crate) fn components(shape: &Shape, operation: &'static str) -> Result<usize, TensorError> {
    let scalar = || TensorError::Shape {
        operation,
        rule: "vectors along a last axis".into(),
        shape: shape.clone(),
    };
    shape.last().copied().ok_or_else(scalar)
}

/// The common shape of two arrays of vectors.
///
/// # Errors
/// [`TensorError::Mismatch`] unless vectors of both have as many components; [`TensorError::Broadcast`]
/// unless the other axes broadcast.
pub(crate) fn common_shape(
    left: &Shape,
    right: &Shape,
    operation: &'static str,
) -> Result<Shape, TensorError> {
    let shapes = || Box::new([left.clone(), right.clone()]);
    if left.last().is_none() || left.last() != right.last() {
        let rule = "vectors of as many components along the last axes".into();
        return Err(TensorError::Mismatch { operation, rule, shapes: shapes() });
    }
    left.broadcast(right).ok_or_else(|| TensorError::Broadcast { operation, shapes: shapes() })
}

/// The vectors of an array, in the order of a shape that it broadcasts to.
pub(crate) struct Vectors<'a, T> {
    entries: &'a [T],
    starts: Walk<1>,
}

/// How the vectors of two arrays lie beside each other: loops over the first three ways are quick.
pub(crate) enum Pairs<'a, T> {
    /// As many on both sides.
    Many([&'a [T]; 2]),
    /// Many, and one for all of them.
    ManyAndOne(&'a [T], &'a [T]),
    /// One for all, and many.
    OneAndMany(&'a [T], &'a [T]),
    Any([Vectors<'a, T>; 2]),
}

impl<'a, T> Pairs<'a, T> {
    /// Those of arrays with these shapes, whose common shape is `full`.
    pub(crate) fn new(operands: [(&'a [T], &Shape); 2], full: &Shape) -> Self {
        let [(x, x_shape), (y, y_shape)] = operands;
        let extent = full.last();
        match (x_shape == full, y_shape == full) {
            (true, true) => Self::Many([x, y]),
            (true, false) if Some(&y.len()) == extent => Self::ManyAndOne(x, y),
            (false, true) if Some(&x.len()) == extent => Self::OneAndMany(x, y),
            _ => Self::Any(operands.map(|operand| Vectors::new(operand, full))),
        }
    }
}

impl<'a, T> Vectors<'a, T> {
    /// Those of an array of `shape`, repeated along the axes that it has not of `full`.
    pub(crate) fn new((entries, shape): (&'a [T], &Shape), full: &Shape) -> Self {
        let outer = axes([full, shape]).take(full.rank() - 1);
        Self { entries, starts: Walk::new(outer.map(|(extent, [_, step])| (extent, [step]))) }
    }

    /// The vector at `row` of the full shape, of so many components.
    #[inline(always)]
    pub(crate) fn row(&self, row: usize, components: usize) -> &'a [T] {
        let [start] = self.starts.position(row);
        &self.entries[start..][..components]
    }
}

/// Writes `number(row, components)` to each row of `out`; rows may be worked on at the same time. The
/// components come as a constant where they are few, so that loops over them have a known length.
#[inline(always)]
pub(crate) fn for_each_vector<S: Send>(
    out: &mut [S],
    components: usize,
    number: impl Fn(usize, usize) -> S + Send + Sync,
) {
    let piece = (ENTRIES_PER_PIECE / components.max(1)).max(1);
    for_each_piece_mut(out, piece, |k, out| {
        let rows = (k * piece..).zip(out);
        match components {
            2 => rows.for_each(|(row, out)| *out = number(row, 2)),
            3 => rows.for_each(|(row, out)| *out = number(row, 3)),
            4 => rows.for_each(|(row, out)| *out = number(row, 4)),
            _ => rows.for_each(|(row, out)| *out = number(row, components)),
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_of_arrays_that_broadcast_are_those_of_a_nest_of_loops() {
        let full = Shape::from([4, 2, 5, 3]);
        for axes in [&[4, 2, 5, 3][..], &[3], &[5, 3], &[2, 1, 3], &[4, 1, 5, 3], &[1, 2, 1, 3]] {
            let shape = Shape::from(axes);
            let entries: Vec<usize> = (0..shape.size()).collect();
            let vectors = Vectors::new((&entries, &shape), &full);
            let steps = shape.strides_in(&full);
            for row in 0..40 {
                let start = row / 10 * steps[0] + row / 5 % 2 * steps[1] + row % 5 * steps[2];
                assert_eq!(vectors.row(row, 3), [start, start + 1, start + 2], "{axes:?} {row}");
            }
        }
    }

    #[test]
    fn each_vector_is_visited_once_with_its_components() {
        for components in [0, 1, 2, 3, 4, 9, 2 * ENTRIES_PER_PIECE] {
            let mut out = vec![[0; 2]; 20_000];
            for_each_vector(&mut out, components, |row, components| [row, components]);
            assert!(out.iter().enumerate().all(|(row, &out)| out == [row, components]));
        }
    }
}
