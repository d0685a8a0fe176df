//! The surface on which a field is 0, as a triangle mesh: marching tetrahedra.
//!
//! # Forward
//! A point of the grid is inside where its value is below 0, as for a signed distance; 0 is outside. Each cell is split
//! into six tetrahedra (`tetrahedra`). An edge of the grid with one end inside has a vertex, where a linear function
//! along the edge is 0 (`vertices`). The fronts of faces are outside.
//!
//! # Backward
//! Gradients of vertices are summed over their edges' ends, in wide numbers (`vertices`). Points without such an edge
//! are not visited.
//!
//! # Where it is not smooth
//! Faces come and go where a value of the field changes its sign. The vertices of the point's edges are then at the
//! point itself, so the surface moves without a jump. At a value of exactly 0 they coincide, and are merged as far as
//! the surface stays a manifold (`coincident`). A merged vertex moves along the first of its edges.
//!
//! # By hand
//! A composition gathers the ends of the edges, and writes some ten arrays of the size of the surface. A step of
//! 193,000 vertices and its gradients take 39 ms so, and 31 ms by hand, of which 20 ms find the surface. With offsets
//! that are learnt they take 61 ms, and 41 ms by hand.
//!
//! # Source
//! Shen et al., *Deep marching tetrahedra*, NeurIPS 2021, eq. (2). Kuhn, *Some combinatorial lemmas in topology*, IBM
//! Journal 4(5), 1960: the six tetrahedra.

mod coincident;
mod signs;
mod tetrahedra;
mod vertices;

use bokashi_core::parallel::merge_ranges;
use bokashi_core::{
    Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Tensor, TensorError, Var,
};
use bokashi_render_ops::{Mesh, RenderError};

use self::coincident::{coincident_edges, collapse};
use self::signs::Signs;
use self::vertices::Points;
use crate::error::MeshError;
use crate::grid::Grid;

/// The number of points of the grid in one piece of work.
const POINTS_PER_PIECE: usize = 1 << 15;

/// A surface on a tape.
#[derive(Debug, Clone)]
pub struct FieldSurface<'t, T: Scalar> {
    /// The positions of the vertices, `[V, 3]`.
    pub positions: Var<'t, T>,
    /// The faces, with their fronts outside.
    pub mesh: Mesh,
    /// The edge of the grid on which each vertex lies: the index of its inner end, then of its outer end.
    pub edges: Vec<[u32; 2]>,
}

/// The surface on which `field` is 0. The field has a value at each point of `grid`, `[nx, ny, nz]` or `[P]`, below 0
/// inside. `offsets: [P, 3]` move the points of the grid.
///
/// The surface is a manifold. It is closed where it does not reach the grid's border, and open there. A field without a
/// change of sign has an empty surface. Values of exactly 0 count as outside. There vertices coincide, and faces
/// without an area are dropped unless that would tear or pinch the surface.
///
/// Offsets along an axis below a sixth of the spacing leave every tetrahedron its orientation; larger ones may fold
/// the surface.
///
/// Where nothing changes sign only the signs of the field are read, and its gradient is 0. Each call makes a new mesh.
///
/// # Errors
/// `TensorError::Shape` for a field or offsets of another shape; [`MeshError::FieldValue`] for a value of the field
/// that is not finite; [`MeshError::PointPosition`] for offsets that are not finite, or that lead out of the range of
/// the numbers; `RenderError::MeshSize` for 2^31 vertices or faces and more.
#[inline(never)]
pub fn field_surface<'t, T: Scalar>(
    field: Var<'t, T>,
    offsets: Option<Var<'t, T>>,
    grid: &Grid,
) -> Result<FieldSurface<'t, T>, MeshError> {
    let inputs: smallvec::SmallVec<[_; 2]> = std::iter::once(field).chain(offsets).collect();
    let look = |saved: &Saved<T>| (saved.mesh.clone(), saved.edges.clone());
    let op = OfField { grid: *grid };
    let (outputs, (mesh, edges)) = field.tape().record_with(op, &inputs, look)?;
    let mesh = mesh.expect("the forward pass makes it");
    Ok(FieldSurface { positions: outputs[0], mesh, edges })
}

/// [`field_surface`] without a tape: the positions `[V, 3]` of the vertices, and the mesh.
///
/// # Errors
/// As [`field_surface`].
pub fn extract_surface<T: Scalar>(
    field: &Tensor<T>,
    offsets: Option<&Tensor<T>>,
    grid: &Grid,
) -> Result<(Tensor<T>, Mesh), MeshError> {
    check(grid, field.shape(), offsets.map(|offsets| &offsets.shape()[..]))?;
    let points = Points { grid, field: field.data(), offsets: offsets.map(Tensor::data) };
    let mut saved = Saved::default();
    saved.extract(points)?;
    let positions = saved.vertices.as_flattened().to_vec();
    let mesh = saved.mesh.expect("it has just been made");
    Ok((Tensor::new([mesh.vertex_count(), 3], positions)?, mesh))
}

const NAME: &str = "field_surface";

/// Checks the shapes of a field and of offsets.
fn check(grid: &Grid, field: &[usize], offsets: Option<&[usize]>) -> Result<(), TensorError> {
    let count = grid.point_count();
    if *field != [count] && *field != grid.shape() {
        let [nx, ny, nz] = grid.shape();
        let rule = format!("a field of shape [{nx}, {ny}, {nz}] or [{count}]").into();
        return Err(TensorError::Shape { operation: NAME, rule, shape: field.into() });
    }
    match offsets {
        Some(shape) if *shape != [count, 3] => {
            let rule = format!("offsets of shape [{count}, 3]").into();
            Err(TensorError::Shape { operation: NAME, rule, shape: shape.into() })
        }
        _ => Ok(()),
    }
}

/// Inputs: a field `[nx, ny, nz]` or `[P]`, and perhaps offsets `[P, 3]`. Output: positions `[V, 3]`.
struct OfField {
    grid: Grid,
}

/// The surface, for the backward pass.
#[derive(Debug)]
struct Saved<T> {
    mesh: Option<Mesh>,
    /// The edge of the grid on which each vertex lies, the inner end first.
    edges: Vec<[u32; 2]>,
    vertices: Vec<[T; 3]>,
}

impl<T> Default for Saved<T> {
    fn default() -> Self {
        Self { mesh: None, edges: Vec::new(), vertices: Vec::new() }
    }
}

impl<T: Scalar> Saved<T> {
    /// Finds the surface of a field.
    fn extract(&mut self, points: Points<'_, T>) -> Result<(), MeshError> {
        let mut signs = Signs::new(points.field, points.grid)?;
        let count = signs.number();
        if count >= 1 << 31 {
            return Err(RenderError::MeshSize { given: count as usize }.into());
        }
        let [nx, ny, nz] = points.grid.shape();
        let layers = (POINTS_PER_PIECE / (ny * nz)).max(1);
        let edges = &mut self.edges;
        edges.clear();
        edges.reserve(count as usize);
        merge_ranges(
            nx,
            layers,
            |layers| signs.crossed_edges(layers.start * ny..layers.end * ny),
            |some| edges.extend(some),
        );
        let mut faces = Vec::new();
        if count > 0 {
            let of = |layers| tetrahedra::faces(&signs, layers);
            merge_ranges(nx - 1, layers, of, |some| faces.extend(some));
        }
        self.vertices.clear();
        self.vertices.resize(edges.len(), [T::ZERO; 3]);
        points.write_vertices(edges, &mut self.vertices)?;
        let coincident = coincident_edges(&faces, &self.vertices);
        if !coincident.is_empty() {
            let kept;
            (kept, faces) = collapse(faces, edges.len(), coincident);
            self.keep(&kept);
        }
        self.mesh = Some(Mesh::new(faces, self.edges.len())?);
        Ok(())
    }

    /// Keeps the vertices with these indices alone.
    fn keep(&mut self, kept: &[u32]) {
        self.edges = kept.iter().map(|&vertex| self.edges[vertex as usize]).collect();
        self.vertices = kept.iter().map(|&vertex| self.vertices[vertex as usize]).collect();
    }
}

impl<T: Scalar> Op<T> for OfField {
    type Saved = Saved<T>;
    type Error = MeshError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Saved<T>,
    ) -> Result<(), MeshError> {
        let has_offsets = inputs.len() > 1;
        check(&self.grid, inputs.shape(0), has_offsets.then(|| &inputs.shape(1)[..]))?;
        let offsets = has_offsets.then(|| inputs.data(1));
        saved.extract(Points { grid: &self.grid, field: inputs.data(0), offsets })?;
        let positions = outputs.push([saved.vertices.len(), 3]);
        positions.copy_from_slice(saved.vertices.as_flattened());
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input_if(1, inputs.len() > 1 && inputs.needs(0))
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Saved<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let upstream = kept.only_upstream().as_chunks::<3>().0;
        let mut points = Points { grid: &self.grid, field: kept.input(0), offsets: None };
        if kept.input_count() > 1
            && let Some(offsets_bar) = gradients.get(1)
        {
            points.pull_back_offsets(&saved.edges, upstream, offsets_bar);
        }
        if let Some(field_bar) = gradients.get(0) {
            points.offsets = (kept.input_count() > 1).then(|| kept.input(1));
            points.pull_back_field(&saved.edges, upstream, field_bar);
        }
    }

    fn saved_bytes(&self, saved: &Saved<T>) -> usize {
        let faces = saved.mesh.as_ref().map_or(0, |mesh| size_of_val(mesh.faces()));
        size_of_val(&saved.edges[..]) + size_of_val(&saved.vertices[..]) + faces
    }
}
