//! What a window sees beyond the border of an image.

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
    pub(crate) fn source(self, position: isize, extent: usize) -> Option<usize> {
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
    pub(crate) fn reach(self, radius: usize, extent: usize) -> usize {
        match self {
            Self::Zero => radius.min(extent - 1),
            Self::Mirror | Self::Clamp => radius,
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
}
