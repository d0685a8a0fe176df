//! A mesh that changes: its faces, the faces at each vertex, and three changes of it: split, collapse and flip.
//!
//! The changes rewire faces without a look at shapes. Each keeps the Euler characteristic and the number of parts, if
//! it is given an [`Edge`] and its own conditions hold.

use bokashi_render_ops::Mesh;
use bokashi_render_ops::edges::repeats_a_vertex;
use bokashi_render_ops::glam::DVec3;
use smallvec::SmallVec;

use super::surface::{Around, Site, Surface};
use crate::box_tree::{Bounds, BoxTree};
use crate::triangle::other_corners;

/// Stands for no vertex and no face. A face that was removed has three such corners.
pub(super) const NONE: u32 = u32::MAX;

/// Which changes a vertex allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// The faces form one ring: the vertex may move and vanish.
    Free,
    /// The faces form one fan at a boundary: the vertex may vanish along the boundary.
    Boundary,
    /// The vertex stays. It lies at a seam, at an edge of three faces, or its faces are no fan.
    Fixed,
}

/// An edge of one face, or of two that run through it in opposite directions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    /// The vertices at the ends. The first face runs from the first to the second.
    pub(super) ends: [u32; 2],
    /// The faces of the edge. The second is [`NONE`] at a boundary.
    pub(super) faces: [u32; 2],
    /// The vertex of each face that is no end of the edge.
    pub(super) across: [u32; 2],
}

impl Edge {
    pub(super) fn is_boundary(&self) -> bool {
        self.faces[1] == NONE
    }

    /// The one or two faces of the edge, each with its vertex across.
    pub(super) fn sides(&self) -> impl Iterator<Item = (u32, u32)> {
        self.faces.into_iter().zip(self.across).filter(|(face, _)| *face != NONE)
    }
}

/// The mesh that changes.
#[derive(Debug)]
pub(super) struct Changing<'a> {
    pub(super) surface: Surface<'a>,
    /// The target length of edges at each old vertex.
    lengths: Vec<f64>,
    /// By vertex: its point of the old surface, its position, the target length of its edges, the changes it allows.
    pub(super) sites: Vec<Site>,
    pub(super) points: Vec<DVec3>,
    pub(super) targets: Vec<f64>,
    pub(super) kinds: Vec<Kind>,
    /// By vertex: whether the surface ends there.
    pub(super) ends_at: Vec<bool>,
    pub(super) around: Around,
    seams: Vec<SmallVec<[u32; 2]>>,
    /// The faces. One that was removed is three times [`NONE`].
    pub(super) faces: Vec<[u32; 3]>,
    /// The number of faces that were not removed.
    pub(super) live: usize,
    /// The boxes of the faces, where changes must not let faces cross.
    pub(super) tree: Option<BoxTree>,
    /// The number `live` when the tree was built.
    planted: usize,
}

impl<'a> Changing<'a> {
    pub(super) fn new(mesh: &'a Mesh, points: &'a [DVec3], lengths: Vec<f64>) -> Self {
        let faces = mesh.faces();
        let surface = Surface::new(faces, points);
        let mut seams = vec![SmallVec::<[u32; 2]>::new(); points.len()];
        for (index, face) in faces.iter().enumerate() {
            for corner in (0..3).filter(|corner| mesh.is_seam(index, *corner)) {
                let [a, b] = [1, 2].map(|step| face[(corner + step) % 3]);
                for (from, to) in [(a, b), (b, a)] {
                    if !seams[from as usize].contains(&to) {
                        seams[from as usize].push(to);
                    }
                }
            }
        }
        let mut fans: Vec<_> =
            (0..points.len() as u32).map(|vertex| fan(vertex, faces, surface.around())).collect();
        // Faces that name a vertex twice are kept, and so are their vertices.
        let twice = faces.iter().filter(|face| repeats_a_vertex(**face));
        twice.flatten().for_each(|&vertex| fans[vertex as usize].0 = Kind::Fixed);
        let kind = |((kind, _), seams): (&(Kind, bool), &SmallVec<[u32; 2]>)| {
            if seams.is_empty() { *kind } else { Kind::Fixed }
        };
        Self {
            sites: (0..points.len() as u32).map(|vertex| surface.site(vertex)).collect(),
            points: points.to_vec(),
            targets: lengths.clone(),
            lengths,
            kinds: fans.iter().zip(&seams).map(kind).collect(),
            ends_at: fans.iter().map(|(_, ends)| *ends).collect(),
            around: surface.around().clone(),
            seams,
            faces: faces.to_vec(),
            live: faces.len(),
            tree: None,
            planted: 0,
            surface,
        }
    }

    /// The positions of a face.
    #[inline]
    pub(super) fn corners(&self, face: [u32; 3]) -> [DVec3; 3] {
        face.map(|vertex| self.points[vertex as usize])
    }

    /// The target length of edges at a point of the old surface: the barycentric mean of those at its corners.
    pub(super) fn target_at(&self, site: Site) -> f64 {
        let weights = self.surface.weights(site);
        weights.iter().map(|&(vertex, weight)| weight * self.lengths[vertex as usize]).sum()
    }

    /// The length of an edge over its target, the smaller of the targets at its ends.
    #[inline]
    pub(super) fn relative_length(&self, a: u32, b: u32) -> f64 {
        let [i, j] = [a as usize, b as usize];
        self.points[i].distance(self.points[j]) / self.targets[i].min(self.targets[j])
    }

    /// Calls `found` with all edges in the order of the faces, each once or twice, with the lower vertex first.
    pub(super) fn for_each_edge(&self, mut found: impl FnMut(u32, u32)) {
        for &[a, b, c] in self.faces.iter().filter(|face| !repeats_a_vertex(**face)) {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                // An edge of two faces is met in the other direction as well.
                let ends = [from, to].map(|vertex| self.kinds[vertex as usize]);
                if from < to || !ends.contains(&Kind::Free) {
                    found(from.min(to), from.max(to));
                }
            }
        }
    }

    /// Two vertices, the one with fewer faces first: an edge between them is found there at the least cost.
    pub(super) fn by_faces(&self, [a, b]: [u32; 2]) -> [u32; 2] {
        let has_fewer = self.around[a as usize].len() <= self.around[b as usize].len();
        if has_fewer { [a, b] } else { [b, a] }
    }

    /// The edge between two vertices. `None` where no face has it, where three faces do, and where two faces run
    /// through it in one direction.
    pub(super) fn edge(&self, a: u32, b: u32) -> Option<Edge> {
        let [least, other] = self.by_faces([a, b]);
        let mut edge = Edge { ends: [a, b], faces: [NONE; 2], across: [NONE; 2] };
        for &index in &self.around[least as usize] {
            let face = self.faces[index as usize];
            if !face.contains(&other) {
                continue;
            }
            let [next, last] = other_corners(face, a);
            let (side, across) = if next == b { (0, last) } else { (1, next) };
            if edge.faces[side] != NONE {
                return None;
            }
            (edge.faces[side], edge.across[side]) = (index, across);
        }
        if edge.faces[0] == NONE {
            edge.ends.swap(0, 1);
            edge.faces.swap(0, 1);
            edge.across.swap(0, 1);
        }
        (edge.faces[0] != NONE).then_some(edge)
    }

    pub(super) fn is_seam(&self, a: u32, b: u32) -> bool {
        self.seams[a as usize].contains(&b)
    }

    /// The vertices of a face after and before `vertex`.
    pub(super) fn other_corners(&self, face: u32, vertex: u32) -> [u32; 2] {
        other_corners(self.faces[face as usize], vertex)
    }

    /// Moves a vertex to a point of the old surface, which gives it another target length.
    pub(super) fn place(&mut self, vertex: u32, site: Site, point: DVec3) {
        let target = self.target_at(site);
        let vertex = vertex as usize;
        (self.sites[vertex], self.points[vertex], self.targets[vertex]) = (site, point, target);
    }

    fn replace(&mut self, face: u32, old: u32, new: u32) {
        for corner in &mut self.faces[face as usize] {
            if *corner == old {
                *corner = new;
            }
        }
    }

    fn leave(&mut self, vertex: u32, face: u32) {
        self.around[vertex as usize].retain(|it| *it != face);
    }

    /// Puts a new vertex m on an edge, and returns it.
    ///
    /// ```text
    ///   c             c
    ///  / \           /|\
    /// a---b   -->   a-m-b      a face that has a keeps it; a new face has b
    ///  \ /           \|/
    ///   d             d
    /// ```
    pub(super) fn split(&mut self, edge: &Edge, site: Site, point: DVec3) -> u32 {
        let [a, b] = edge.ends;
        let middle = self.points.len() as u32;
        let is_seam = self.is_seam(a, b);
        self.sites.push(site);
        self.points.push(point);
        self.targets.push(self.target_at(site));
        self.ends_at.push(edge.is_boundary());
        self.kinds.push(match (is_seam, edge.is_boundary()) {
            (true, _) => Kind::Fixed,
            (false, true) => Kind::Boundary,
            (false, false) => Kind::Free,
        });
        self.around.push(SmallVec::new());
        self.seams.push(SmallVec::new());
        if is_seam {
            self.seams[middle as usize] = SmallVec::from([a, b]);
            for (end, other) in [(a, b), (b, a)] {
                let seam = self.seams[end as usize].iter_mut().find(|it| **it == other);
                seam.into_iter().for_each(|it| *it = middle);
            }
        }
        for (face, across) in edge.sides() {
            let added = self.faces.len() as u32;
            self.faces.push(self.faces[face as usize]);
            self.replace(face, b, middle);
            self.replace(added, a, middle);
            self.leave(b, face);
            self.around[b as usize].push(added);
            self.around[across as usize].push(added);
            self.around[middle as usize].extend([face, added]);
            self.live += 1;
            if let Some(tree) = &mut self.tree {
                // Its box is given below.
                tree.add_beside(face, Bounds::around(&[]));
            }
        }
        self.note(middle);
        middle
    }

    /// Joins the end `gone` of an edge with its other end, which moves to `point`. The faces of the edge are removed.
    ///
    /// # Conditions
    /// Only the vertices across the edge are neighbours of both ends. Each of them keeps two faces, or one at a
    /// boundary. `gone` has no seam.
    pub(super) fn collapse(&mut self, edge: &Edge, gone: u32, site: Site, point: DVec3) {
        let [a, b] = edge.ends;
        let kept = if gone == a { b } else { a };
        for (face, across) in edge.sides() {
            for vertex in [kept, across] {
                self.leave(vertex, face);
            }
            self.faces[face as usize] = [NONE; 3];
            self.live -= 1;
            if let Some(tree) = &mut self.tree {
                tree.change(face, Bounds::around(&[]));
            }
        }
        for face in std::mem::take(&mut self.around[gone as usize]) {
            if self.faces[face as usize][0] != NONE {
                self.replace(face, gone, kept);
                self.around[kept as usize].push(face);
            }
        }
        if site != self.sites[kept as usize] {
            self.place(kept, site, point);
        }
        self.note(kept);
        // Boxes of nodes only grow: those around the few large faces that are left would all meet.
        if self.tree.is_some() && 2 * self.live < self.planted {
            self.plant();
        }
    }

    /// Flips an edge of two faces f and g. The vertices across must not be neighbours yet.
    ///
    /// ```text
    ///   c             c
    ///  /f\           /|\
    /// a---b   -->   af|gb
    ///  \g/           \|/
    ///   d             d
    /// ```
    pub(super) fn flip(&mut self, edge: &Edge) {
        let ([a, b], [f, g], [c, d]) = (edge.ends, edge.faces, edge.across);
        self.replace(f, b, d);
        self.replace(g, a, c);
        self.leave(a, g);
        self.leave(b, f);
        self.around[c as usize].push(g);
        self.around[d as usize].push(f);
        [f, g].into_iter().for_each(|face| self.note_face(face));
    }

    /// Gives the tree the boxes of the faces at a vertex, after they have changed.
    pub(super) fn note(&mut self, vertex: u32) {
        for k in 0..self.around[vertex as usize].len() {
            self.note_face(self.around[vertex as usize][k]);
        }
    }

    fn note_face(&mut self, face: u32) {
        let corners = self.corners(self.faces[face as usize]);
        if let Some(tree) = &mut self.tree {
            tree.change(face, Bounds::around(&corners));
        }
    }

    /// Builds the tree anew.
    pub(super) fn plant(&mut self) {
        let bounds = |face: &[u32; 3]| {
            if repeats_a_vertex(*face) {
                Bounds::around(&[])
            } else {
                Bounds::around(&self.corners(*face))
            }
        };
        let bounds: Vec<_> = self.faces.iter().map(bounds).collect();
        self.tree = Some(BoxTree::new(&bounds));
        self.planted = self.live;
    }
}

/// The changes that the faces at a vertex allow, and whether the surface ends there.
fn fan(vertex: u32, faces: &[[u32; 3]], around: &Around) -> (Kind, bool) {
    // A face (vertex, p, q) is a step from p to q around the vertex. Steps of a ring close, and those of a fan go from
    // a start that no step ends at. So with one start or none, and no vertex met twice, it is enough to count the steps
    // of a walk: all of them, or there is more than one ring.
    let own = around[vertex as usize].iter();
    let mut steps: SmallVec<[[u32; 2]; 8]> =
        own.map(|&face| other_corners(faces[face as usize], vertex)).collect();
    steps.sort_unstable();
    let mut ends: SmallVec<[u32; 8]> = steps.iter().map(|step| step[1]).collect();
    ends.sort_unstable();
    let is_start = |step: &&[u32; 2]| ends.binary_search(&step[0]).is_err();
    let (mut starts, ends_at) = (steps.iter().filter(is_start), steps.iter().any(|s| is_start(&s)));
    let twice = steps.windows(2).any(|pair| pair[0][0] == pair[1][0])
        || ends.windows(2).any(|pair| pair[0] == pair[1]);
    let Some(first) = starts.next().or(steps.first()) else { return (Kind::Fixed, false) };
    if twice || starts.next().is_some() {
        return (Kind::Fixed, ends_at);
    }
    let (mut at, mut walked) = (first[0], 0);
    while let Ok(index) = steps.binary_search_by_key(&at, |step| step[0]) {
        (at, walked) = (steps[index][1], walked + 1);
        if at == first[0] {
            break;
        }
    }
    let is_one = walked == steps.len();
    let kind = match (is_one, ends_at) {
        (true, true) => Kind::Boundary,
        (true, false) if steps.len() > 2 => Kind::Free,
        _ => Kind::Fixed,
    };
    (kind, ends_at)
}
