//! The texels around a place.

use bokashi_core::Scalar;

use super::chart::Place;

/// The texels of a level along rows and columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extents<T> {
    /// Rows and columns.
    pub(super) counts: [usize; 2],
    /// Columns and rows, as places on a face have them.
    pub(super) scale: [T; 2],
}

impl<T: Scalar> Extents<T> {
    pub(super) fn new(counts: [usize; 2]) -> Self {
        let [rows, columns] = counts.map(|count| T::from_f64(count as f64));
        Self { counts, scale: [columns, rows] }
    }

    /// Derivatives along the axes of a face, from those in texels.
    #[inline(always)]
    pub(super) fn along_face(&self, slopes: [T; 2]) -> [T; 2] {
        [self.scale[0] * slopes[0], self.scale[1] * slopes[1]]
    }
}

/// The four texels around a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell<T> {
    pub(super) face: usize,
    /// Row and column of the upper left texel, from -1 on.
    pub(super) at: [isize; 2],
    /// f and g: how far the place lies from it to the right and down.
    pub(super) fractions: [T; 2],
}

impl<T: Scalar> Cell<T> {
    /// The cell of a place, where there is one.
    #[inline(always)]
    pub(super) fn around(place: Place<T>, extents: &Extents<T>, ends: bool) -> Option<Self> {
        let half = T::from_f64(0.5);
        let x = place.at[0] * extents.scale[0] - half;
        let y = place.at[1] * extents.scale[1] - half;
        let (left, upper) = (x.to_f64().floor(), y.to_f64().floor());
        let [rows, columns] = extents.counts;
        if ends && !(left >= -1.0 && upper >= -1.0 && left < columns as f64 && upper < rows as f64)
        {
            return None;
        }
        let fractions = [x - T::from_f64(left), y - T::from_f64(upper)];
        Some(Self { face: place.face, at: [upper as isize, left as isize], fractions })
    }

    /// The cell whose upper left texel is nearest to a place, where there is one, with fractions 0.
    #[inline(always)]
    pub(super) fn nearest(place: Place<T>, extents: &Extents<T>, ends: bool) -> Option<Self> {
        let [rows, columns] = extents.counts;
        let x = place.at[0].to_f64() * columns as f64;
        let y = place.at[1].to_f64() * rows as f64;
        if ends && !(x >= 0.0 && y >= 0.0 && x < columns as f64 && y < rows as f64) {
            return None;
        }
        let index = |at: f64, count: usize| (at as isize).min(count as isize - 1);
        let at = [index(y, rows), index(x, columns)];
        Some(Self { face: place.face, at, fractions: [T::ZERO; 2] })
    }
}
