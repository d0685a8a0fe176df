//! How a mesh is remeshed.

use bokashi_core::TensorError;

/// How long edges should be, in units of the positions.
#[derive(Debug, Clone, PartialEq)]
pub enum EdgeLengths {
    /// All alike.
    Uniform(f64),
    /// One for each old vertex; between them, as barycentric coordinates blend it. Of an edge's ends the
    /// shorter counts.
    PerVertex(Vec<f64>),
}

/// How [`remesh`](crate::remesh()) changes a mesh.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RemeshOptions {
    /// How long edges should be.
    pub lengths: EdgeLengths,
    /// How often all edges are split, collapsed and flipped: 5.
    pub iterations: usize,
    /// Whether vertices move along the surface, which makes faces more regular: they do. Where they don't, most
    /// old vertices that are kept stay where they are.
    pub moves_vertices: bool,
    /// Whether changes that let faces cross are left out: they are.
    pub keeps_apart: bool,
    /// Edges are split only while there are fewer faces: 2^20.
    pub most_faces: usize,
}

impl RemeshOptions {
    /// Toward edges of one length.
    pub fn uniform(length: f64) -> Self {
        Self::new(EdgeLengths::Uniform(length))
    }

    /// Toward edges of a length per old vertex.
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
