//! Lines with what a window sees beyond their ends, and its adjoint.

use bokashi_core::Scalar;

use super::convolution::Lines;
use crate::border::Border;

/// Writes the lines of `image` to `padded`, each with its padding at either end.
pub(super) fn pad<T: Scalar>(border: Border, image: &[T], lines: Lines, padded: &mut Vec<T>) {
    let Lines { lines, extent, cell, pad } = lines;
    let length = extent + 2 * pad;
    padded.resize(lines * length * cell, T::ZERO);
    for (line, padded) in padded.chunks_exact_mut(length * cell).enumerate() {
        let image = &image[line * extent * cell..][..extent * cell];
        padded[pad * cell..][..extent * cell].copy_from_slice(image);
        for position in (0..pad).chain(pad + extent..length) {
            let to = &mut padded[position * cell..][..cell];
            match border.source(position as isize - pad as isize, extent) {
                Some(from) => to.copy_from_slice(&image[from * cell..][..cell]),
                None => to.fill(T::ZERO),
            }
        }
    }
}

/// Adds to the first and the last cell of each line of `y` what a window with these weights,
/// spread from each cell of `g`, puts beyond that end of the line.
pub(super) fn add_overhang<T: Scalar>(g: &[T], lines: Lines, weights: &[T], y: &mut [T]) {
    let Lines { extent, cell, .. } = lines;
    let lines = g.chunks_exact(extent * cell).zip(y.chunks_exact_mut(extent * cell));
    for (g, y) in lines {
        // Of the j-th cell from an end, the taps from j + 1 on lie beyond it.
        let mut tail: T = weights[1..].iter().copied().sum();
        for j in 0..extent.min(weights.len() - 1) {
            for c in 0..cell {
                y[c] += tail * g[j * cell + c];
                y[(extent - 1) * cell + c] += tail * g[(extent - 1 - j) * cell + c];
            }
            tail -= weights[j + 1];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_repeats_cells_by_the_border_rule() {
        let mut padded = Vec::new();
        let lines = Lines { lines: 1, extent: 2, cell: 2, pad: 3 };
        pad(Border::Mirror, &[1.0, 2.0, 3.0, 4.0], lines, &mut padded);
        let cells: Vec<_> = padded.chunks(2).map(|cell| cell[0]).collect();
        assert_eq!(cells, [3.0, 3.0, 1.0, 1.0, 3.0, 3.0, 1.0, 1.0]);
    }
}
