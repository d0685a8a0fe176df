//! The surface of a mesh in numbers.

use bokashi_render_ops::edges::{edges, sides};
use glam::DVec3;

use crate::model::Geometry;

/// A face is degenerate below so many roundings of its coordinates.
const ROUNDINGS: f64 = 2.0;

/// The surface of a mesh in numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshSummary {
    /// The least and the largest coordinates, in the mesh's own; `None` without vertices.
    pub extent: Option<[[f32; 3]; 2]>,
    /// Edges that one face has alone.
    pub boundary_edges: usize,
    /// Edges that three or more faces share.
    pub crowded_edges: usize,
    /// Edges of two faces that run along them in the same direction: one of the two is inside out.
    pub turned_edges: usize,
    /// Faces without an area, to within the rounding of their coordinates.
    pub degenerate_faces: usize,
    /// Faces with the same three vertices as an earlier one.
    pub repeated_faces: usize,
    /// The volume inside, for a closed surface whose faces agree. Below 0 it is inside out.
    pub volume: Option<f64>,
}

impl MeshSummary {
    /// The surface of `geometry`.
    ///
    /// # Panics
    /// Where a face names a vertex that is not there.
    pub fn new(geometry: &Geometry) -> Self {
        let Geometry { positions, faces, .. } = geometry;
        let position = |vertex: u32| DVec3::from(positions[vertex as usize].map(f64::from));
        let largest = positions.iter().flatten().fold(0.0_f32, |most, x| most.max(x.abs()));
        let rounding = ROUNDINGS * f64::from(largest) * f64::from(f32::EPSILON);
        let is_degenerate = |face: &&[u32; 3]| {
            let [a, b, c] = face.map(position);
            let longest = (b - a).length().max((c - b).length()).max((a - c).length());
            (b - a).cross(c - a).length() <= rounding * longest
        };
        let degenerate_faces = faces.iter().filter(is_degenerate).count();
        let mut same: Vec<_> = faces.to_vec();
        same.iter_mut().for_each(|face| face.sort_unstable());
        same.sort_unstable();
        same.dedup();
        let [boundary_edges, crowded_edges, turned_edges] = count_edges(faces);
        let is_solid = !faces.is_empty() && boundary_edges + crowded_edges + turned_edges == 0;
        // Six times tetrahedra to a place nearby: far from the origin theirs would cancel.
        let middle = faces.first().map_or(DVec3::ZERO, |face| position(face[0]));
        let volume = |face: &[u32; 3]| {
            let [a, b, c] = face.map(|vertex| position(vertex) - middle);
            a.dot(b.cross(c))
        };
        let bound = |pick: fn(f32, f32) -> f32| {
            positions.iter().copied().reduce(|a, b| [0, 1, 2].map(|k| pick(a[k], b[k])))
        };
        Self {
            extent: bound(f32::min).zip(bound(f32::max)).map(|(least, most)| [least, most]),
            boundary_edges,
            crowded_edges,
            turned_edges,
            degenerate_faces,
            repeated_faces: faces.len() - same.len(),
            volume: is_solid.then(|| faces.iter().map(volume).sum::<f64>() / 6.0),
        }
    }

    /// Whether each edge has two faces.
    pub fn is_closed(&self) -> bool {
        self.boundary_edges == 0 && self.crowded_edges == 0
    }
}

/// How many edges have one face, three or more, and two that run along them in the same direction.
fn count_edges(faces: &[[u32; 3]]) -> [usize; 3] {
    let [mut boundary, mut crowded, mut turned] = [0; 3];
    for edge in edges(&sides(faces)) {
        match edge {
            [_] => boundary += 1,
            [one, other] => turned += usize::from(one.rises == other.rises),
            _ => crowded += 1,
        }
    }
    [boundary, crowded, turned]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    fn of_faces(faces: &[[u32; 3]]) -> MeshSummary {
        MeshSummary::new(&Geometry { faces: faces.to_vec(), ..shapes::cube(12) })
    }

    #[test]
    fn a_cube_is_closed_and_has_its_volume() {
        let cube = shapes::cube(12);
        let found = MeshSummary::new(&cube);
        assert!(found.is_closed());
        assert_eq!(found.extent, Some([[-1.0; 3], [1.0; 3]]));
        assert_eq!(found.volume, Some(8.0));
        let counts = [found.turned_edges, found.degenerate_faces, found.repeated_faces];
        assert_eq!(counts, [0; 3]);
        let turned: Vec<_> = cube.faces.iter().map(|&[a, b, c]| [a, c, b]).collect();
        assert_eq!(of_faces(&turned).volume, Some(-8.0));
    }

    #[test]
    fn what_is_wrong_with_a_surface_is_counted() {
        let cube = shapes::cube(12).faces;
        let open = of_faces(&cube[1..]);
        assert_eq!((open.boundary_edges, open.is_closed(), open.volume), (3, false, None));
        let [a, b, c] = cube[0];
        let mut one_turned = cube.clone();
        one_turned[0] = [a, c, b];
        let found = of_faces(&one_turned);
        assert_eq!((found.turned_edges, found.volume), (3, None));
        let repeated = of_faces(&[cube.as_slice(), &[[b, c, a]]].concat());
        assert_eq!((repeated.repeated_faces, repeated.crowded_edges), (1, 3));
    }

    #[test]
    fn a_face_is_degenerate_at_any_scale_and_thin_ones_are_not() {
        let mut mesh = shapes::plane(2);
        mesh.faces = vec![[0, 1, 2]];
        for scale in [1e-12, 1.0, 1e12_f32] {
            let row = |x: f32, y: f32| [scale * x, scale * y, 0.0];
            mesh.positions = vec![row(0.0, 0.0), row(1.0, 1.0), row(0.3, 0.3)];
            assert_eq!(MeshSummary::new(&mesh).degenerate_faces, 1, "{scale}");
            mesh.positions[2] = row(0.3, 0.30001);
            assert_eq!(MeshSummary::new(&mesh).degenerate_faces, 0, "{scale}");
        }
    }

    #[test]
    fn nothing_has_no_extent() {
        let found =
            MeshSummary::new(&Geometry { positions: vec![], faces: vec![], ..shapes::cube(12) });
        assert_eq!((found.extent, found.volume), (None, None));
    }
}
