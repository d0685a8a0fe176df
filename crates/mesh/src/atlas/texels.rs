//! The point of a surface that each texel shows.

use std::collections::VecDeque;
use std::sync::Arc;

use bokashi_core::{Scalar, Tensor, TensorError};
use bokashi_render_ops::Mesh;
use bokashi_render_ops::edges::repeats_a_vertex;
use bokashi_render_ops::glam::DVec3;

use super::options::check_size;
use crate::error::MeshError;
use crate::triangle::nearest;

/// A point of a face.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    face: u32,
    weights: [f64; 3],
    /// The squared distance from the texel's middle, in texels.
    distance: f64,
}

/// The points of faces that the texels of a square texture show.
///
/// A texel whose middle is less than a diagonal from a face shows the point of all faces nearest to its middle.
/// Bilinear samples on faces read no other texels. Each other texel is a copy of the nearest texel that shows a point.
/// So coarse levels of detail mix only colours of the surface.
#[derive(Debug, Clone)]
pub struct TexelMap {
    size: usize,
    places: Vec<Option<Place>>,
    sources: Arc<[u32]>,
}

impl TexelMap {
    /// Maps a texture of `size` by `size` texels to faces with the texture coordinates `coordinates: [T, 2]`, whose
    /// rows `corners` names for each face. A million texels take about a second.
    ///
    /// # Errors
    /// [`TensorError::Value`] for a size that is not from 1 to 2^14, and for coordinates that are not finite;
    /// [`TensorError::Shape`] unless there are coordinates for each of `corners`.
    pub fn new<T: Scalar>(
        coordinates: &Tensor<T>,
        corners: &Mesh,
        size: usize,
    ) -> Result<Self, MeshError> {
        const OPERATION: &str = "TexelMap::new";
        check_size(OPERATION, size)?;
        if **coordinates.shape() != [corners.vertex_count(), 2] {
            let rule = format!("coordinates of shape [{}, 2]", corners.vertex_count()).into();
            let shape = coordinates.shape().clone();
            return Err(TensorError::Shape { operation: OPERATION, rule, shape }.into());
        }
        if let Some(value) = coordinates.data().iter().find(|x| !x.is_finite()) {
            let (rule, value) = ("finite coordinates".into(), value.to_f64());
            return Err(TensorError::Value { operation: OPERATION, rule, value }.into());
        }
        // Far outside nothing is near a texel.
        let texel = |x: &T| (x.to_f64() * size as f64).clamp(-1e6, 1e6);
        let points: Vec<_> = coordinates.data().chunks_exact(2).collect();
        let mut map = Self { size, places: vec![None; size * size], sources: Arc::default() };
        for (face, index) in corners.faces().iter().zip(0..) {
            let corners = face.map(|row| {
                let row = points[row as usize];
                DVec3::new(texel(&row[0]), texel(&row[1]), 0.0)
            });
            if !repeats_a_vertex(*face)
                && (corners[1] - corners[0]).cross(corners[2] - corners[0]).z != 0.0
            {
                map.put(index, corners);
            }
        }
        map.fill();
        Ok(map)
    }

    /// Gives texels near a face the nearest points of it, where no other face was nearer. A diagonal has the square 2.
    fn put(&mut self, face: u32, corners: [DVec3; 3]) {
        let low = corners[0].min(corners[1]).min(corners[2]) - 2.0;
        let high = corners[0].max(corners[1]).max(corners[2]) + 2.0;
        let range =
            |low: f64, high: f64| low.max(0.0) as usize..high.clamp(0.0, self.size as f64) as usize;
        for row in range(low.y, high.y) {
            for column in range(low.x, high.x) {
                let middle = DVec3::new(column as f64 + 0.5, row as f64 + 0.5, 0.0);
                let (weights, distance) = nearest(corners, middle);
                let place = &mut self.places[row * self.size + column];
                if distance < 2.0 && place.is_none_or(|place| distance < place.distance) {
                    *place = Some(Place { face, weights, distance });
                }
            }
        }
    }

    /// Finds the texels to copy from, by breadth-first search from all texels that show a point.
    fn fill(&mut self) {
        let size = self.size as isize;
        let mut sources: Vec<u32> = (0..self.places.len() as u32).collect();
        let mut is_filled: Vec<_> = self.places.iter().map(Option::is_some).collect();
        let mut open: VecDeque<u32> =
            sources.iter().copied().filter(|texel| is_filled[*texel as usize]).collect();
        while let Some(texel) = open.pop_front() {
            let [row, column] = [texel as isize / size, texel as isize % size];
            // Texels that share a side come before those that share a corner.
            for [down, right] in
                [[-1, 0], [0, -1], [0, 1], [1, 0], [-1, -1], [-1, 1], [1, -1], [1, 1]]
            {
                let [row, column] = [row + down, column + right];
                if (0..size).contains(&row) && (0..size).contains(&column) {
                    let next = (row * size + column) as usize;
                    if !std::mem::replace(&mut is_filled[next], true) {
                        sources[next] = sources[texel as usize];
                        open.push_back(next as u32);
                    }
                }
            }
        }
        self.sources = sources.into();
    }

    /// The number of texels along each side.
    pub fn size(&self) -> usize {
        self.size
    }

    /// The texel of which each texel is a copy, row by row. A texel that shows a point is its own source.
    pub fn sources(&self) -> &Arc<[u32]> {
        &self.sources
    }

    /// The face that a texel shows, and the barycentric coordinates of the point. `None` for a copy.
    pub fn point(&self, row: usize, column: usize) -> Option<(u32, [f64; 3])> {
        let place = self.places[row * self.size + column]?;
        Some((place.face, place.weights))
    }

    /// Bakes `values: [V, C]` at the vertices of `mesh`, whose faces are those of the map, into texels `[S, S, C]`.
    /// Texels are zeros where no face has an area.
    ///
    /// # Errors
    /// [`TensorError::Shape`] unless there is a row for each vertex; [`TensorError::Value`] for another number of
    /// faces.
    pub fn bake<T: Scalar>(&self, values: &Tensor<T>, mesh: &Mesh) -> Result<Tensor<T>, MeshError> {
        let &[rows, columns] = &**values.shape() else {
            return Err(self.refused(values, mesh));
        };
        let last = self.places.iter().flatten().map(|place| place.face).max();
        if rows != mesh.vertex_count()
            || last.is_some_and(|face| face as usize >= mesh.faces().len())
        {
            return Err(self.refused(values, mesh));
        }
        let at = |texel: u32, column: usize| {
            self.places[texel as usize].map_or(T::ZERO, |Place { face, weights, .. }| {
                let corners = mesh.faces()[face as usize];
                let sum =
                    corners.iter().zip(weights).fold(T::Wide::ZERO, |sum, (&vertex, weight)| {
                        let value = values.data()[vertex as usize * columns + column];
                        sum + T::Wide::from_f64(weight) * value.widen()
                    });
                T::narrow(sum)
            })
        };
        let data = self.sources.iter();
        let data = data.flat_map(|&texel| (0..columns).map(move |column| at(texel, column)));
        Ok(Tensor::new([self.size, self.size, columns], data.collect())?)
    }

    fn refused<T: Scalar>(&self, values: &Tensor<T>, mesh: &Mesh) -> MeshError {
        let rule = format!(
            "values of shape [{}, C] at the vertices of the map's faces",
            mesh.vertex_count()
        );
        let (operation, shape) = ("TexelMap::bake", values.shape().clone());
        TensorError::Shape { operation, rule: rule.into(), shape }.into()
    }
}
