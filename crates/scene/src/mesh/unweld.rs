//! Vertices with one index for all of their attributes, as the formats that are written have them.

use crate::mesh::weld::same_keys;
use crate::model::{Geometry, Indexed, NO_ROW};

/// The faces of a geometry, and for each of their vertices the numbers of its position, its colour, its
/// coordinates, its normal and its tangent; [`NO_ROW`] for what the geometry or the submesh lacks.
///
/// Vertices come in the order of their positions, and those with one position in the order of the corners:
/// welding gives the geometry back.
#[derive(Debug)]
pub(super) struct Unwelded {
    pub(super) vertices: Vec<[u32; 5]>,
    pub(super) faces: Vec<[u32; 3]>,
}

impl Unwelded {
    /// Of a geometry that was checked.
    pub(super) fn new(geometry: &Geometry) -> Self {
        let Geometry { faces, colors, coordinates, normals, tangents, .. } = geometry;
        let key = |corner: usize| {
            let (face, k) = (corner / 3, corner % 3);
            let [colors, coordinates] = [row(colors, face, k), row(coordinates, face, k)];
            [faces[face][k], colors, coordinates, row(normals, face, k), row(tangents, face, k)]
        };
        let same = same_keys(3 * faces.len(), key);
        let is_first = |corner: &u32| same[*corner as usize] == *corner;
        let mut corners: Vec<u32> = (0..same.len() as u32).filter(is_first).collect();
        corners.sort_unstable_by_key(|&corner| (key(corner as usize)[0], corner));
        let mut numbers = vec![0; same.len()];
        for (number, &corner) in corners.iter().enumerate() {
            numbers[corner as usize] = number as u32;
        }
        let vertices = corners.into_iter().map(|corner| key(corner as usize)).collect();
        let (triples, _) = same.as_chunks::<3>();
        let number = |corner: u32| numbers[corner as usize];
        Self { vertices, faces: triples.iter().map(|triple| triple.map(number)).collect() }
    }
}

/// A row of an attribute, or else `none`.
pub(super) fn row_or<const N: usize>(rows: &Indexed<N>, row: u32, none: [f32; N]) -> [f32; N] {
    if row == NO_ROW { none } else { rows.rows[row as usize] }
}

fn row<const N: usize>(indexed: &Option<Indexed<N>>, face: usize, k: usize) -> u32 {
    indexed.as_ref().map_or(NO_ROW, |indexed| indexed.faces[face][k])
}
