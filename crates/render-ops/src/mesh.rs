//! Triangle meshes: which vertices make a face, and which faces share an edge.

use std::num::NonZeroU32;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use crate::corners::Corners;
use crate::edges::{edges, sides};
use crate::error::RenderError;

/// The faces of a triangle mesh: for each face the indices of its three vertices.
///
/// Serves as the index buffer of positions and, with its own vertex count, of attributes. Cheap to
/// clone: clones, also those with other seams, share the faces, the adjacency and the corners at each
/// vertex. These are built once, when first asked for.
#[derive(Debug, Clone)]
pub struct Mesh {
    topology: Arc<Topology>,
    /// Per face: a bit for each corner whose edge is a seam; empty where there is none.
    seams: Arc<[u8]>,
}

#[derive(Debug)]
struct Topology {
    faces: Vec<[u32; 3]>,
    vertex_count: usize,
    adjacency: OnceLock<Adjacency>,
    shared_edges: OnceLock<Vec<SharedEdge>>,
    corners: OnceLock<Corners>,
}

impl Mesh {
    /// The mesh of `faces` over `vertex_count` vertices.
    ///
    /// A face may name a vertex twice: it has no area, is never drawn and has no neighbours.
    ///
    /// # Errors
    /// [`RenderError::FaceIndex`] for an index that is not below `vertex_count`;
    /// [`RenderError::MeshSize`] for 2^31 faces or vertices and more.
    pub fn new(faces: Vec<[u32; 3]>, vertex_count: usize) -> Result<Self, RenderError> {
        let limit = 1_usize << 31;
        for given in [faces.len(), vertex_count] {
            if given >= limit {
                return Err(RenderError::MeshSize { given });
            }
        }
        for (face, indices) in faces.iter().enumerate() {
            if let Some(&index) = indices.iter().find(|&&index| index as usize >= vertex_count) {
                return Err(RenderError::FaceIndex { face, index, vertex_count });
            }
        }
        Ok(Self::from_checked(faces, vertex_count, Arc::default()))
    }

    fn from_checked(faces: Vec<[u32; 3]>, vertex_count: usize, seams: Arc<[u8]>) -> Self {
        let topology = Topology {
            faces,
            vertex_count,
            adjacency: OnceLock::new(),
            shared_edges: OnceLock::new(),
            corners: OnceLock::new(),
        };
        Self { topology: Arc::new(topology), seams }
    }

    /// The faces of several meshes one after another, each with the index of its first vertex among
    /// `vertex_count`, which has to be so large that its vertices fit. Their seams stay seams.
    ///
    /// # Errors
    /// [`RenderError::MeshSize`] for 2^31 faces or vertices and more.
    pub(crate) fn joined<'a>(
        parts: impl Iterator<Item = (&'a Self, usize)> + Clone,
        vertex_count: usize,
    ) -> Result<Self, RenderError> {
        let limit = 1_usize << 31;
        let count = |sum: usize, (mesh, _): (&Self, usize)| sum.saturating_add(mesh.faces().len());
        for given in [parts.clone().fold(0, count), vertex_count] {
            if given >= limit {
                return Err(RenderError::MeshSize { given });
            }
        }
        let faces = parts.clone().flat_map(|(mesh, first)| {
            mesh.faces().iter().map(move |face| face.map(|vertex| vertex + first as u32))
        });
        let has_seams = parts.clone().any(|(mesh, _)| !mesh.seams.is_empty());
        let seams_of =
            |(mesh, _): (&'a Self, usize)| (0..mesh.faces().len()).map(|face| mesh.seams_of(face));
        let seams = if has_seams { parts.flat_map(seams_of).collect() } else { Arc::default() };
        Ok(Self::from_checked(faces.collect(), vertex_count, seams))
    }

    /// Some neighbouring faces over the same vertices; seams stay seams.
    ///
    /// # Errors
    /// [`RenderError::MeshPart`] for a range that is not one of the faces.
    pub fn part(&self, faces: Range<usize>) -> Result<Self, RenderError> {
        let Range { start, end } = faces;
        let Some(part) = self.faces().get(start..end) else {
            return Err(RenderError::MeshPart { start, end, faces: self.faces().len() });
        };
        let seams = self.seams.get(start..end).unwrap_or_default();
        Ok(Self::from_checked(part.to_vec(), self.vertex_count(), seams.into()))
    }

    /// The same mesh with seams. `is_seam(face, corner)` says whether the edge that faces a corner
    /// of a face is a seam; it is enough that it says so for one of the edge's two faces.
    ///
    /// With [exact coverage](crate::Sampling::Exact) the pixels that a seam crosses are resolved into
    /// pieces, like pixels at silhouettes. Mark edges where the surface goes on but what is shown
    /// jumps or bends: creases, and borders between faces with attributes of their own.
    #[must_use]
    pub fn with_seams(&self, is_seam: impl Fn(usize, usize) -> bool) -> Self {
        let edge = |face: usize, corner: usize| {
            let [a, b] = [1, 2].map(|k| self.faces()[face][(corner + k) % 3]);
            [a.min(b), a.max(b)]
        };
        let is_seam = |face: usize, corner: usize| {
            is_seam(face, corner)
                || self.adjacency().neighbor(face, corner).is_some_and(|neighbor| {
                    let other = neighbor.face();
                    let is_same = |k: &usize| edge(other, *k) == edge(face, corner);
                    (0..3).filter(is_same).any(|k| is_seam(other, k))
                })
        };
        let of_face = |face| (0..3).map(|corner| u8::from(is_seam(face, corner)) << corner).sum();
        let seams = (0..self.faces().len()).map(of_face).collect();
        Self { topology: Arc::clone(&self.topology), seams }
    }

    /// The same mesh whose seams are its own and `more`: whether each of the [shared edges](Self::shared_edges)
    /// is one.
    pub(crate) fn with_more_seams(&self, more: &[bool]) -> Self {
        // Few are, and most meshes have none.
        const AT_ONCE: usize = 64;
        let mut seams = Vec::new();
        let edges = self.shared_edges().chunks(AT_ONCE);
        for (edges, more) in edges.zip(more.chunks(AT_ONCE)) {
            if !more.iter().fold(false, |some, more| some | more) {
                continue;
            }
            if seams.is_empty() {
                seams = self.seams.to_vec();
                seams.resize(self.faces().len(), 0);
            }
            for (edge, _) in edges.iter().zip(more).filter(|(_, more)| **more) {
                for (face, corner) in edge.faces.into_iter().zip(edge.corners) {
                    seams[face as usize] |= 1 << corner;
                }
            }
        }
        if seams.is_empty() {
            return self.clone();
        }
        Self { topology: Arc::clone(&self.topology), seams: seams.into() }
    }

    /// Whether a face says that its edge facing a corner is a seam.
    #[inline(always)]
    pub fn is_seam(&self, face: usize, corner: usize) -> bool {
        self.seams_of(face) >> corner & 1 == 1
    }

    /// A bit for each corner of a face whose edge it says is a seam.
    #[inline(always)]
    pub(crate) fn seams_of(&self, face: usize) -> u8 {
        self.seams.get(face).copied().unwrap_or_default()
    }

    /// Where the surface ends or turns away, as it is seen. Per face `orientations` has the sign of its area, or 0 for a
    /// face that covers nothing.
    #[inline(always)]
    pub(crate) fn silhouette_edges<'a>(&'a self, orientations: &'a [i8]) -> SilhouetteEdges<'a> {
        SilhouetteEdges { neighbors: &self.adjacency().neighbors, orientations }
    }

    /// The vertex indices of each face.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.topology.faces
    }

    /// The number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.topology.vertex_count
    }

    /// Whether both are clones of one mesh, perhaps with other seams.
    pub(crate) fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.topology, &other.topology)
    }

    /// Which faces share an edge.
    #[inline]
    pub fn adjacency(&self) -> &Adjacency {
        self.topology.adjacency.get_or_init(|| Adjacency::new(&self.topology.faces))
    }

    /// The edges of exactly two faces, in the order of the first of them.
    pub(crate) fn shared_edges(&self) -> &[SharedEdge] {
        let Topology { faces, shared_edges, .. } = &*self.topology;
        shared_edges.get_or_init(|| SharedEdge::all(faces, self.adjacency()))
    }

    /// Which corners stand at each vertex.
    pub(crate) fn corners(&self) -> &Corners {
        self.topology
            .corners
            .get_or_init(|| Corners::new(&self.topology.faces, self.topology.vertex_count))
    }
}

/// Which faces share an edge of a mesh, by vertex index.
///
/// An edge of exactly two faces joins them. An edge of a single face is a *boundary*; where
/// vertices are duplicated, as at a texture seam, both sides are boundaries. An edge of three or
/// more faces joins none of them: each treats it as a boundary, since from every side some face
/// ends there.
#[derive(Debug, Clone, Default)]
pub struct Adjacency {
    /// Per face and corner k: the vertex across the edge that faces corner k, or [`NO_VERTEX`].
    across: Vec<[u32; 3]>,
    /// Likewise the other face at that edge.
    neighbors: Vec<[Option<Neighbor>; 3]>,
    boundary_edges: usize,
    crowded_edges: usize,
}

/// The other face at an edge, and whether it runs through the edge's vertices in the other order, as neighbours in an
/// oriented surface do. Stored as 1 + 2 face, and 1 more where it does: never 0, so that an `Option` takes four bytes, and
/// of a fine mesh less memory is read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Neighbor(NonZeroU32);

impl Neighbor {
    fn new(face: u32, is_opposite: bool) -> Self {
        let bits = 2 * face + u32::from(is_opposite);
        Self(NonZeroU32::MIN.checked_add(bits).expect("fewer than 2^31 faces"))
    }

    #[inline(always)]
    pub(crate) fn face(self) -> usize {
        ((self.0.get() - 1) >> 1) as usize
    }

    #[inline(always)]
    fn is_opposite(self) -> bool {
        (self.0.get() - 1) & 1 == 1
    }

    /// Whether both faces, of these orientations, lie on the same side of the edge in the image, or
    /// one of them covers neither.
    #[inline]
    pub(crate) fn is_turned(self, orientation: i8, other: i8) -> bool {
        let product = orientation * other;
        if self.is_opposite() { product <= 0 } else { product >= 0 }
    }
}

/// The edges at which a surface ends, or turns away.
///
/// It ends where no face lies beyond the edge. It turns away where both faces lie on the same side of the edge in the
/// image. A face seen edge-on, to within rounding, covers neither side, and neither does a culled face. So the other
/// face ends there, too.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SilhouetteEdges<'a> {
    /// Per face, as in [`Adjacency`].
    neighbors: &'a [[Option<Neighbor>; 3]],
    /// See [`Mesh::silhouette_edges`].
    orientations: &'a [i8],
}

impl SilhouetteEdges<'_> {
    /// Finds those of a face: a bit for the corner that each faces.
    #[inline(always)]
    pub(crate) fn find(&self, face: usize) -> u8 {
        let own = self.orientations[face];
        let bit = |neighbor: &Option<Neighbor>| {
            neighbor
                .is_none_or(|neighbor| neighbor.is_turned(own, self.orientations[neighbor.face()]))
        };
        // Not by `map`, which would be a call.
        let [a, b, c] = &self.neighbors[face];
        u8::from(bit(a)) | u8::from(bit(b)) << 1 | u8::from(bit(c)) << 2
    }
}

/// An edge of exactly two faces.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SharedEdge {
    /// The vertices p, q, s and r: the edge runs from p to q, its first face is (p, q, s), and r lies across.
    pub(crate) vertices: [u32; 4],
    /// The lower face first.
    pub(crate) faces: [u32; 2],
    /// Which corner of each face faces the edge.
    corners: [u8; 2],
    /// As of a [`Neighbor`].
    is_opposite: bool,
}

impl SharedEdge {
    fn all(faces: &[[u32; 3]], adjacency: &Adjacency) -> Vec<Self> {
        let count = adjacency.neighbors.as_flattened().iter().flatten().count() / 2;
        let mut edges = Vec::with_capacity(count);
        for (face, neighbors) in adjacency.neighbors.iter().enumerate() {
            for (corner, neighbor) in neighbors.iter().enumerate() {
                let Some(neighbor) = *neighbor else { continue };
                let other = neighbor.face();
                if other > face {
                    let is_beyond = |k: &usize| {
                        adjacency.neighbor(other, *k).is_some_and(|back| back.face() == face)
                            && adjacency.across[other][*k] == faces[face][corner]
                    };
                    let third = (0..3).find(is_beyond).expect("both faces have the edge");
                    let mut edge = Self {
                        vertices: [0; 4],
                        faces: [face as u32, other as u32],
                        corners: [corner as u8, third as u8],
                        is_opposite: neighbor.is_opposite(),
                    };
                    let [p, q, s, r, ..] = edge.corners_of(faces);
                    edge.vertices = [p, q, s, r];
                    edges.push(edge);
                }
            }
        }
        edges
    }

    /// What the index buffer `indices` has at p, q, s and r, and at p and q in the face beyond.
    #[inline(always)]
    pub(crate) fn corners_of(&self, indices: &[[u32; 3]]) -> [u32; 6] {
        let [own, beyond] = self.faces.map(|face| indices[face as usize]);
        let [s, r] = self.corners.map(usize::from);
        let [next, last] = [1, 2].map(|k| beyond[(r + k) % 3]);
        let [p, q] = if self.is_opposite { [last, next] } else { [next, last] };
        [own[(s + 1) % 3], own[(s + 2) % 3], own[s], beyond[r], p, q]
    }
}

/// Stands for "no face on the other side".
const NO_VERTEX: u32 = u32::MAX;

impl Adjacency {
    fn new(faces: &[[u32; 3]]) -> Self {
        let mut adjacency = Self {
            across: vec![[NO_VERTEX; 3]; faces.len()],
            neighbors: vec![[None; 3]; faces.len()],
            ..Self::default()
        };
        for edge in edges(&sides(faces)) {
            match *edge {
                [_] => adjacency.boundary_edges += 1,
                [one, other] => {
                    let [[f, j], [g, k]] =
                        [one, other].map(|side| [side.face as usize, usize::from(side.corner)]);
                    adjacency.across[f][j] = faces[g][k];
                    adjacency.across[g][k] = faces[f][j];
                    let is_opposite = one.rises != other.rises;
                    adjacency.neighbors[f][j] = Some(Neighbor::new(other.face, is_opposite));
                    adjacency.neighbors[g][k] = Some(Neighbor::new(one.face, is_opposite));
                }
                _ => adjacency.crowded_edges += 1,
            }
        }
        adjacency
    }

    /// The vertex across the edge that faces corner `corner` of `face`: the corner of the other
    /// face that does not lie on that edge. `None` unless there is exactly one other face.
    ///
    /// # Panics
    /// Unless the mesh has such a face, and `corner` is below 3.
    pub fn across(&self, face: usize, corner: usize) -> Option<u32> {
        let vertex = self.across[face][corner];
        (vertex != NO_VERTEX).then_some(vertex)
    }

    /// The other face at the edge that faces corner `corner` of `face`, where there is exactly one.
    pub(crate) fn neighbor(&self, face: usize, corner: usize) -> Option<Neighbor> {
        self.neighbors[face][corner]
    }

    /// [`Self::neighbor`] of each corner of `face`.
    #[inline(always)]
    pub(crate) fn neighbors(&self, face: usize) -> &[Option<Neighbor>; 3] {
        &self.neighbors[face]
    }

    /// The number of edges that one face has alone.
    pub fn boundary_edges(&self) -> usize {
        self.boundary_edges
    }

    /// The number of edges that three or more faces share.
    pub fn crowded_edges(&self) -> usize {
        self.crowded_edges
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_share_the_adjacency_and_the_corners() {
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let clone = mesh.clone();
        assert!(std::ptr::eq(mesh.adjacency(), clone.adjacency()));
        assert!(std::ptr::eq(mesh.corners(), clone.corners()));
    }

    #[test]
    fn a_part_has_its_own_neighbours_and_the_seams_it_had() {
        let mesh = Mesh::new(vec![[0, 1, 2], [2, 1, 3], [3, 1, 4]], 5).unwrap();
        let creased = mesh.with_seams(|face, corner| (face, corner) == (1, 0));
        let part = creased.part(1..3).unwrap();
        assert_eq!((part.faces(), part.vertex_count()), (&mesh.faces()[1..], 5));
        assert_eq!([0, 1, 2].map(|corner| part.is_seam(0, corner)), [true, false, false]);
        assert_eq!((part.adjacency().across(0, 0), part.adjacency().across(0, 2)), (Some(4), None));
        assert!(mesh.part(3..3).unwrap().faces().is_empty());
        for (start, end) in [(2, 4), (2, 1)] {
            assert_eq!(
                mesh.part(start..end).unwrap_err(),
                RenderError::MeshPart { start, end, faces: 3 }
            );
        }
    }

    #[test]
    fn an_edge_has_its_vertices_in_both_faces_whatever_they_share() {
        let tetrahedron = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        for faces in [tetrahedron, vec![[0, 1, 2], [0, 2, 1]], vec![[0, 1, 2], [1, 2, 0]]] {
            let mesh = Mesh::new(faces, 4).unwrap();
            assert_eq!(mesh.shared_edges().len(), 3 * mesh.faces().len() / 2);
            for edge in mesh.shared_edges() {
                let [p, q, s, r, p_beyond, q_beyond] = edge.corners_of(mesh.faces());
                assert_eq!(edge.vertices, [p, q, s, r]);
                assert_eq!([p, q], [p_beyond, q_beyond], "{edge:?}");
                assert!([s, r].iter().all(|vertex| ![p, q].contains(vertex)), "{edge:?}");
            }
        }
    }

    #[test]
    fn a_neighbor_is_any_face_of_a_mesh() {
        for face in [0, 1, 1 << 30, (1 << 31) - 2] {
            for is_opposite in [false, true] {
                let neighbor = Neighbor::new(face, is_opposite);
                assert_eq!((neighbor.face(), neighbor.is_opposite()), (face as usize, is_opposite));
            }
        }
        assert_eq!(size_of::<Option<Neighbor>>(), 4);
    }
}
