//! The old surface that is remeshed, its points, and projections to it.

use bokashi_render_ops::edges::repeats_a_vertex;
use bokashi_render_ops::glam::DVec3;
use smallvec::SmallVec;

use crate::triangle::nearest;

/// The faces at each vertex, in increasing order.
pub(super) type Around = Vec<SmallVec<[u32; 8]>>;

/// The faces at each vertex, but for those that name a vertex twice.
pub(super) fn around(faces: &[[u32; 3]], vertex_count: usize) -> Around {
    let mut around = vec![SmallVec::new(); vertex_count];
    for (face, index) in faces.iter().zip(0..).filter(|(face, _)| !repeats_a_vertex(**face)) {
        face.iter().for_each(|&vertex| around[vertex as usize].push(index));
    }
    around
}

/// A point of the surface: its face and barycentric coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Site {
    pub(super) face: u32,
    pub(super) weights: [f64; 3],
}

impl Site {
    /// Stands for the point of a vertex without a face. Such a vertex stays where it is.
    pub(super) const NOWHERE: Self = Self { face: u32::MAX, weights: [0.0; 3] };
}

/// The old mesh.
#[derive(Debug)]
pub(super) struct Surface<'a> {
    faces: &'a [[u32; 3]],
    points: &'a [DVec3],
    around: Around,
}

impl<'a> Surface<'a> {
    pub(super) fn new(faces: &'a [[u32; 3]], points: &'a [DVec3]) -> Self {
        Self { faces, points, around: around(faces, points.len()) }
    }

    pub(super) fn around(&self) -> &Around {
        &self.around
    }

    /// The point at which an old vertex lies.
    pub(super) fn site(&self, vertex: u32) -> Site {
        let Some(&face) = self.around[vertex as usize].first() else { return Site::NOWHERE };
        let weight = |corner| f64::from(u8::from(corner == vertex));
        Site { face, weights: self.faces[face as usize].map(weight) }
    }

    /// The old vertices of a site's face, with their weights.
    pub(super) fn weights(&self, site: Site) -> [(u32, f64); 3] {
        let face = self.faces[site.face as usize];
        [0, 1, 2].map(|k| (face[k], site.weights[k]))
    }

    pub(super) fn point(&self, site: Site) -> DVec3 {
        self.weights(site).iter().map(|&(v, weight)| weight * self.points[v as usize]).sum()
    }

    /// The nearest point to `p` that a walk finds which starts at `start` and goes from face to face, each time nearer.
    /// So the point stays on the sheet of `start` where another sheet lies nearer. Also the square of its distance.
    pub(super) fn nearest(&self, start: Site, p: DVec3) -> (Site, f64) {
        let mut best = self.nearest_on(start.face, p);
        // The faces beside `start` come first: seen from one of them a fold may hide another.
        let mut from = start;
        // Each round is nearer than the last one, so the walk ends.
        loop {
            let distance = best.1;
            let ends = self.weights(from).into_iter().filter(|(_, weight)| *weight > 0.0);
            let ends: SmallVec<[u32; 3]> = ends.map(|(vertex, _)| vertex).collect();
            if ends.len() < 3 {
                let lists = ends.iter().map(|end| &self.around[*end as usize]);
                for &face in lists.min_by_key(|list| list.len()).into_iter().flatten() {
                    let has_all = ends.iter().all(|end| self.faces[face as usize].contains(end));
                    if has_all && face != from.face {
                        let found = self.nearest_on(face, p);
                        if found.1 < best.1 {
                            best = found;
                        }
                    }
                }
            }
            if from != start && best.1 >= distance || from == best.0 {
                return best;
            }
            from = best.0;
        }
    }

    fn nearest_on(&self, face: u32, p: DVec3) -> (Site, f64) {
        let corners = self.faces[face as usize].map(|vertex| self.points[vertex as usize]);
        let (weights, square) = nearest(corners, p);
        (Site { face, weights }, square)
    }
}
