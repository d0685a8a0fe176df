//! Regular grids of points, at which a field is given.

use bokashi_core::{Scalar, Tensor};

use crate::error::MeshError;

/// A regular grid of points along x, y and z, the corners of cubic cells.
///
/// The point (i, j, k) stands at `origin + spacing (i, j, k)`. Of `[nx, ny, nz]` points it has the index
/// `(i ny + j) nz + k`: numbers at points are a tensor of that shape, row-major as all tensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    shape: [usize; 3],
    origin: [f64; 3],
    spacing: f64,
}

impl Grid {
    /// A grid of `shape` = [nx, ny, nz] points, the first of them at `origin`; neighbours are `spacing` apart.
    ///
    /// # Errors
    /// [`MeshError::GridShape`] unless there is a cell and there are fewer than 2^31 points;
    /// [`MeshError::GridPlace`] unless all points have finite coordinates, and `spacing` is positive.
    pub fn new(shape: [usize; 3], origin: [f64; 3], spacing: f64) -> Result<Self, MeshError> {
        let [nx, ny, nz] = shape;
        let count = nx.checked_mul(ny).and_then(|rows| rows.checked_mul(nz));
        let is_counted = count.is_some_and(|count| count < 1 << 31);
        if !is_counted || shape.into_iter().any(|extent| extent < 2) {
            return Err(MeshError::GridShape { shape });
        }
        let grid = Self { shape, origin, spacing };
        let last = grid.position(nx * ny * nz - 1);
        let is_placed = origin.into_iter().chain(last).all(f64::is_finite);
        if !is_placed || spacing.is_nan() || spacing <= 0.0 {
            return Err(MeshError::GridPlace { origin, spacing });
        }
        Ok(grid)
    }

    /// The grid with `cells` cells along the longest side of the box from `low` to `high`.
    ///
    /// One more layer of cells is around the box on every side. So a field whose shape lies in the box is outside at
    /// the border.
    ///
    /// # Errors
    /// [`MeshError::GridBox`] where `low` is above `high` along an axis; as [`Self::new`] for the grid that comes out.
    pub fn around(low: [f64; 3], high: [f64; 3], cells: usize) -> Result<Self, MeshError> {
        if (0..3).any(|axis| low[axis] > high[axis]) {
            return Err(MeshError::GridBox { low, high });
        }
        let extents = [0, 1, 2].map(|axis| high[axis] - low[axis]);
        let spacing = extents.into_iter().fold(0.0, f64::max) / cells as f64;
        // In whole cells; where that is no number, there are none, and `new` says so.
        let shape = extents.map(|extent| (extent / spacing - 1e-9).ceil() as usize);
        let margin = |axis: usize| 0.5 * (spacing * shape[axis] as f64 - extents[axis]) + spacing;
        let origin = [0, 1, 2].map(|axis| low[axis] - margin(axis));
        Self::new(shape.map(|cells| cells.saturating_add(3)), origin, spacing)
    }

    /// How many points there are along x, y and z.
    pub fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// Where the first point stands.
    pub fn origin(&self) -> [f64; 3] {
        self.origin
    }

    /// The distance from a point to the next one along an axis.
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// How many points there are.
    pub fn point_count(&self) -> usize {
        self.shape.iter().product()
    }

    /// The place (i, j, k) of the point with an index.
    pub fn place(&self, point: usize) -> [usize; 3] {
        let [_, ny, nz] = self.shape;
        [point / (ny * nz), point / nz % ny, point % nz]
    }

    /// Where the point with an index stands.
    pub fn position(&self, point: usize) -> [f64; 3] {
        let place = self.place(point);
        [0, 1, 2].map(|axis| self.origin[axis] + self.spacing * place[axis] as f64)
    }

    /// Where all points stand: `[P, 3]`, in the order of their indices.
    pub fn positions<T: Scalar>(&self) -> Tensor<T> {
        Tensor::from_fn([self.point_count(), 3], |[point, axis]| {
            T::from_f64(self.position(point)[axis])
        })
    }

    /// The numbers `value(position)` at all points: `[nx, ny, nz]`.
    pub fn sampled<T: Scalar>(&self, value: impl Fn([f64; 3]) -> f64) -> Tensor<T> {
        Tensor::from_flat_fn(self.shape, |point| T::from_f64(value(self.position(point))))
    }
}
