//! The neighbours with which a vertex is smoothed.

use bokashi_render_ops::Mesh;
use bokashi_render_ops::edges::{Side, edges};

/// The neighbours with which each vertex is smoothed.
///
/// A vertex whose edges all have two faces has all its neighbours. Where two edges have another number of faces, as at
/// a boundary, it has the other ends of these two. So a boundary depends on itself alone. Corners at which surfaces
/// meet, and vertices without a face, have none.
#[derive(Debug)]
pub(crate) struct Rings {
    starts: Vec<usize>,
    neighbors: Vec<u32>,
    is_boundary: Vec<bool>,
}

impl Rings {
    /// The neighbours in a mesh, whose [sides](bokashi_render_ops::edges::sides) are given.
    pub(crate) fn new(mesh: &Mesh, sides: &[Side]) -> Self {
        let count = mesh.vertex_count();
        let (mut all, mut sharp) = (vec![0_u32; count], vec![0_u32; count]);
        for edge in edges(sides) {
            for end in edge[0].ends {
                all[end as usize] += 1;
                sharp[end as usize] += u32::from(edge.len() != 2);
            }
        }
        let mut starts = Vec::with_capacity(count + 1);
        let mut sum = 0;
        starts.push(sum);
        for (all, sharp) in all.iter().zip(&sharp) {
            sum += match sharp {
                0 => *all as usize,
                2 => 2,
                _ => 0,
            };
            starts.push(sum);
        }
        let (mut next, mut neighbors) = (starts.clone(), vec![0; sum]);
        for edge in edges(sides) {
            let [a, b] = edge[0].ends;
            for (end, other) in [(a, b), (b, a)] {
                let counts =
                    sharp[end as usize] == 0 || sharp[end as usize] == 2 && edge.len() != 2;
                if counts {
                    neighbors[next[end as usize]] = other;
                    next[end as usize] += 1;
                }
            }
        }
        Self { starts, neighbors, is_boundary: sharp.iter().map(|sharp| *sharp == 2).collect() }
    }

    /// The neighbours of a vertex, in increasing order.
    pub(crate) fn neighbors(&self, vertex: usize) -> &[u32] {
        &self.neighbors[self.starts[vertex]..self.starts[vertex + 1]]
    }

    /// Whether a vertex is smoothed along a boundary.
    pub(crate) fn is_boundary(&self, vertex: usize) -> bool {
        self.is_boundary[vertex]
    }
}
