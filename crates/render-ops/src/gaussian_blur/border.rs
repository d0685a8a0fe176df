//! What a window sees beyond the border of an image.

use bokashi_core::Scalar;

use super::convolution::Lines;

/// What a window sees beyond the border of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Border {
    /// Zeros: the image darkens towards its border. The map is self-adjoint.
    Zero,
    /// The image, mirrored about the outer edge of its border pixels, again and again. Keeps
    /// constant images and, exactly, the sum of all pixels; the map is self-adjoint.
    #[default]
    Mirror,
    /// The nearest border pixel. Keeps constant images; the adjoint piles up on the border pixels.
    Clamp,
}

impl Border {
    /// The pixel, of `extent` in a line, that stands at `position`; `None` for a zero.
    pub(super) fn source(self, position: isize, extent: usize) -> Option<usize> {
        let n = extent as isize;
        match self {
            Self::Zero => (0..n).contains(&position).then_some(position as usize),
            Self::Clamp => Some(position.clamp(0, n - 1) as usize),
            Self::Mirror => {
                let phase = position.rem_euclid(2 * n);
                Some(if phase < n { phase } else { 2 * n - 1 - phase } as usize)
            }
        }
    }

    /// How far a window of radius `radius` sees anything beyond the border that counts.
    pub(super) fn reach(self, radius: usize, extent: usize) -> usize {
        match self {
            Self::Zero => radius.min(extent - 1),
            Self::Mirror | Self::Clamp => radius,
        }
    }
}

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
    fn positions_beyond_the_border_map_back_by_rule() {
        let sources = |border: Border| -> Vec<_> {
            (-5..8).map(|position| border.source(position, 3)).collect()
        };
        let some = |indices: [usize; 13]| indices.map(Some).to_vec();
        assert_eq!(sources(Border::Mirror), some([1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]));
        assert_eq!(sources(Border::Clamp), some([0, 0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2, 2]));
        let zero = sources(Border::Zero);
        assert!(zero[..5].iter().chain(&zero[8..]).all(Option::is_none));
        assert_eq!(zero[5..8], [Some(0), Some(1), Some(2)]);
    }

    #[test]
    fn padding_repeats_cells_by_the_border_rule() {
        let mut padded = Vec::new();
        let lines = Lines { lines: 1, extent: 2, cell: 2, pad: 3 };
        pad(Border::Mirror, &[1.0, 2.0, 3.0, 4.0], lines, &mut padded);
        let cells: Vec<_> = padded.chunks(2).map(|cell| cell[0]).collect();
        assert_eq!(cells, [3.0, 3.0, 1.0, 1.0, 3.0, 3.0, 1.0, 1.0]);
    }
}
