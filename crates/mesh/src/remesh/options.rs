//! Options of remeshing.

use bokashi_core::TensorError;

/// Target lengths of edges, in units of the positions.
#[derive(Debug, Clone, PartialEq)]
pub enum EdgeLengths {
    /// One length for all edges.
    Uniform(f64),
    /// A length for each old vertex, interpolated over its faces. The smaller length at the ends of an edge counts.
    PerVertex(Vec<f64>),
}

/// Options of [`remesh`](crate::remesh()).
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RemeshOptions {
    /// The target lengths of edges.
    pub lengths: EdgeLengths,
    /// The number of rounds in which all edges are split, collapsed and flipped; 5 by default.
    pub iterations: usize,
    /// Whether vertices move along the surface, which makes faces more regular; true by default. If not, most old
    /// vertices that are kept stay where they are.
    pub moves_vertices: bool,
    /// Whether changes that let faces cross are left out; true by default.
    pub keeps_apart: bool,
    /// The number of faces from which on no edge is split; 2^20 by default.
    pub most_faces: usize,
}

impl RemeshOptions {
    /// Options with one length for all edges.
    pub fn uniform(length: f64) -> Self {
        Self::new(EdgeLengths::Uniform(length))
    }

    /// Options with a length for each old vertex.
    pub fn adaptive(lengths: Vec<f64>) -> Self {
        Self::new(EdgeLengths::PerVertex(lengths))
    }

    fn new(lengths: EdgeLengths) -> Self {
        let (iterations, most_faces) = (5, 1 << 20);
        Self { lengths, iterations, moves_vertices: true, keeps_apart: true, most_faces }
    }

    /// The lengths of the `count` vertices, divided by `unit`.
    pub(super) fn lengths_of(&self, count: usize, unit: f64) -> Result<Vec<f64>, TensorError> {
        let operation = "remesh";
        let lengths = match &self.lengths {
            EdgeLengths::Uniform(length) => vec![*length; count.max(1)],
            EdgeLengths::PerVertex(lengths) => {
                if lengths.len() != count {
                    let rule = format!("a length for each of the {count} vertices").into();
                    let value = lengths.len() as f64;
                    return Err(TensorError::Value { operation, rule, value });
                }
                lengths.clone()
            }
        };
        if let Some(&value) = lengths.iter().find(|it| !(it.is_finite() && **it > 0.0)) {
            let rule = "finite lengths above 0".into();
            return Err(TensorError::Value { operation, rule, value });
        }
        // Far longer than the mesh is as good as any such length.
        Ok(lengths.iter().map(|length| (length / unit).clamp(1e-9, 1e9)).collect())
    }
}
