//! Meshes that change, surfaces of fields, distances between surfaces.
//!
//! What has no gradient is computed in double precision, whatever the type of its arrays.

use bokashi_core::Tensor;
use bokashi_mesh::{self as mesh, PointDistance, RemeshOptions, Smoothing, Subdivision};
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smallvec::smallvec;

use crate::array::{Array, Number, by_type, to_array};
use crate::error::Refusal;
use crate::mesh::Mesh;
use crate::pull_back::PullBack;
use crate::step::{Recorded, record};
use crate::tensors::Sparse;
use crate::threads::released;

/// The points at which a field is given: `shape` (nx, ny, nz) of them, at equal distances along each axis.
#[pyclass(frozen, module = "bokashi")]
pub struct Grid(mesh::Grid);

#[pymethods]
impl Grid {
    #[new]
    fn new(shape: [usize; 3], origin: [f64; 3], spacing: f64) -> PyResult<Self> {
        Ok(Self(mesh::Grid::new(shape, origin, spacing).map_err(Refusal::from)?))
    }

    /// The grid of a box with `cells` cells along its longest side, and one more layer of cells on every side.
    #[staticmethod]
    fn around(low: [f64; 3], high: [f64; 3], cells: usize) -> PyResult<Self> {
        Ok(Self(mesh::Grid::around(low, high, cells).map_err(Refusal::from)?))
    }

    /// How many points there are along x, y and z.
    #[getter]
    fn shape(&self) -> (usize, usize, usize) {
        self.0.shape().into()
    }

    /// Where the first point stands.
    #[getter]
    fn origin(&self) -> (f64, f64, f64) {
        self.0.origin().into()
    }

    /// The distance from a point to the next one along an axis.
    #[getter]
    fn spacing(&self) -> f64 {
        self.0.spacing()
    }

    /// Where all points stand, `[nx, ny, nz, 3]`, `float64`: made anew each time.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let [nx, ny, nz] = self.0.shape();
        let positions = self.0.positions::<f64>().reshaped([nx, ny, nz, 3]);
        to_array(py, positions.map_err(Refusal::from)?)
    }

    fn __repr__(&self) -> String {
        let ([nx, ny, nz], [x, y, z]) = (self.0.shape(), self.0.origin());
        format!("Grid(({nx}, {ny}, {nz}), ({x}, {y}, {z}), {})", self.0.spacing())
    }
}

/// How a mesh hangs together: parts, boundaries, the Euler characteristic. A face that names a vertex twice counts as
/// none. Faces that share an edge hang together; those that share a vertex alone do not.
#[pyclass(frozen, module = "bokashi")]
pub struct Connectivity {
    counts: mesh::Connectivity,
    face_count: usize,
}

/// Numbers that are asked for by name.
macro_rules! facts {
    ($($(#[$doc:meta])* $name:ident: $type:ty = $value:expr;)+) => {
        #[pymethods]
        impl Connectivity {
            #[new]
            fn new(py: Python<'_>, mesh: &Mesh) -> Self {
                let counts = released(py, || mesh::Connectivity::new(&mesh.0));
                Self { counts, face_count: mesh.0.faces().len() }
            }

            $($(#[$doc])* #[getter] fn $name(&self) -> $type {
                let value: fn(&mesh::Connectivity) -> $type = $value;
                value(&self.counts)
            })+

            /// The part of each face, `[F]`, `int32`: 0 for that of the first face, -1 for a face that counts as none.
            #[getter]
            fn part_of_face<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i32>> {
                let part = |face| self.counts.part_of(face).map_or(-1, |part| part as i32);
                PyArray1::from_iter(py, (0..self.face_count).map(part))
            }

            fn __repr__(&self) -> String {
                let (counts, euler) = (&self.counts, self.counts.euler_characteristic());
                format!(
                    "Connectivity({} parts, {} boundary loops, Euler characteristic {euler})",
                    counts.parts(),
                    counts.boundary_loops
                )
            }
        }
    };
}

facts! {
    /// Vertices that some face has.
    vertices: usize = |counts| counts.vertices;
    /// Edges.
    edges: usize = |counts| counts.edges;
    /// Faces that name three vertices.
    faces: usize = |counts| counts.faces;
    /// Edges of one face.
    boundary_edges: usize = |counts| counts.boundary_edges;
    /// Edges of three faces and more.
    crowded_edges: usize = |counts| counts.crowded_edges;
    /// Vertices at which faces meet that share no edge.
    pinched_vertices: usize = |counts| counts.pinched_vertices;
    /// Rings of edges at which the surface ends, or meets more than one other.
    boundary_loops: usize = |counts| counts.boundary_loops;
    /// The number of parts.
    parts: usize = |counts| counts.parts();
    /// Vertices minus edges plus faces: 2 for each closed part, less 2 for each of its handles.
    euler_characteristic: i64 = |counts| counts.euler_characteristic();
    /// Whether each edge has two faces or more.
    is_closed: bool = |counts| counts.is_closed();
    /// Whether the surface looks like a disc, or half of one, around each point of it.
    is_manifold: bool = |counts| counts.is_manifold();
    /// Whether two faces run through each edge that they share in opposite directions.
    is_oriented: bool = |counts| counts.is_oriented;
}

#[pyfunction]
#[pyo3(signature = (field, offsets, grid))]
pub fn field_surface<'py>(
    py: Python<'py>,
    field: Array<'py>,
    offsets: Option<Array<'py>>,
    grid: &Grid,
) -> PyResult<(Mesh, Bound<'py, pyo3::types::PyTuple>, PullBack)> {
    let (inputs, grid) = ([Some(&field), offsets.as_ref()], grid.0);
    let [nx, ny, nz] = grid.shape();
    let mut made = None;
    let (outputs, pull_back) = by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        // A row for each point, or the shape of the grid's own positions.
        let offsets = match x[1] {
            Some(offsets) if *offsets.shape() == [nx, ny, nz, 3] => {
                Some(offsets.reshape([grid.point_count(), 3])?)
            }
            offsets => offsets,
        };
        let surface = mesh::field_surface(x[0].expect("it is required"), offsets, &grid)?;
        made = Some(Mesh(surface.mesh));
        Ok(smallvec![surface.positions])
    }))?;
    Ok((made.expect("the step makes it"), outputs, pull_back))
}

#[pyfunction]
#[pyo3(signature = (a, b, squared=true))]
pub fn chamfer_distance<'py>(
    py: Python<'py>,
    a: Array<'py>,
    b: Array<'py>,
    squared: bool,
) -> Recorded<'py> {
    let distance = if squared { PointDistance::Squared } else { PointDistance::Euclidean };
    let inputs = [Some(&a), Some(&b)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(a), Some(b)] = x[..] else { unreachable!("they are required") };
        Ok(smallvec![mesh::chamfer_distance(a, b, distance)?])
    }))
}

#[pyfunction]
#[pyo3(signature = (positions, mesh, count, seed=0))]
pub fn draw_points<'py>(
    py: Python<'py>,
    positions: Array<'py>,
    mesh: &Mesh,
    count: usize,
    seed: u64,
) -> Recorded<'py> {
    let (inputs, faces) = ([Some(&positions)], &mesh.0);
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let positions = x[0].expect("they are required");
        let points = mesh::draw_points(&positions.value(), faces, count, seed)?;
        Ok(smallvec![points.interpolate(positions)?])
    }))
}

/// A mesh of another one: positions, faces, and the weights of the old vertices.
type Derived<'py> = PyResult<(Bound<'py, PyAny>, Mesh, Sparse)>;

/// A mesh that `work` makes of positions, whose type the new positions have.
fn derived<'py>(
    py: Python<'py>,
    positions: &Array<'py>,
    work: impl FnOnce(&Tensor<f64>) -> Result<mesh::DerivedMesh<f64>, mesh::MeshError> + Send,
) -> Derived<'py> {
    let old = positions.constant_tensor()?;
    let made = released(py, || work(&old)).map_err(Refusal::from)?;
    let positions = match positions {
        Array::Single(_) => f32::to_array(py, made.positions.cast())?,
        _ => f64::to_array(py, made.positions)?,
    };
    Ok((positions, Mesh(made.mesh), Sparse::from_matrix(made.weights)))
}

#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "Python has names for them")]
pub fn remesh<'py>(
    py: Python<'py>,
    positions: Array<'py>,
    mesh: &Mesh,
    length: Array<'py>,
    iterations: usize,
    moves_vertices: bool,
    keeps_apart: bool,
    most_faces: usize,
) -> Derived<'py> {
    let (shape, lengths) = length.constant()?;
    let mut options = match (shape, &lengths[..]) {
        ([], &[length]) => RemeshOptions::uniform(length),
        ([_], _) => RemeshOptions::adaptive(lengths),
        _ => {
            return Err(PyValueError::new_err(format!(
                "remesh needs one length or a length for each vertex, [V], got shape {shape:?}"
            )));
        }
    };
    (options.iterations, options.most_faces) = (iterations, most_faces);
    (options.moves_vertices, options.keeps_apart) = (moves_vertices, keeps_apart);
    derived(py, &positions, |old| mesh::remesh(old, &mesh.0, &options))
}

#[pyfunction]
pub fn subdivide<'py>(
    py: Python<'py>,
    positions: Array<'py>,
    mesh: &Mesh,
    scheme: &str,
) -> Derived<'py> {
    let scheme = match scheme {
        "midpoint" => Subdivision::Midpoint,
        "loop" => Subdivision::Loop,
        _ => {
            return Err(PyValueError::new_err(format!(
                "scheme needs to be midpoint or loop, got {scheme:?}"
            )));
        }
    };
    derived(py, &positions, |old| mesh::subdivide(old, &mesh.0, scheme))
}

#[pyfunction]
pub fn smooth<'py>(
    py: Python<'py>,
    positions: Array<'py>,
    mesh: &Mesh,
    iterations: usize,
    shrink: f64,
    swell: Option<f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let smoothing = match swell {
        Some(swell) => Smoothing::Taubin { shrink, swell },
        None => Smoothing::Laplacian(shrink),
    };
    let old = positions.constant_tensor()?;
    // In the type of the result, whose range it must not leave.
    if let Array::Single(_) = positions {
        let old = old.cast::<f32>();
        let made = released(py, || mesh::smooth(&old, &mesh.0, smoothing, iterations));
        return f32::to_array(py, made.map_err(Refusal::from)?);
    }
    let made = released(py, || mesh::smooth(&old, &mesh.0, smoothing, iterations));
    f64::to_array(py, made.map_err(Refusal::from)?)
}

/// A number of a surface.
macro_rules! measures {
    ($($name:ident)+) => {$(
        #[pyfunction]
        pub fn $name(py: Python<'_>, positions: Array<'_>, mesh: &Mesh) -> PyResult<f64> {
            let positions = positions.constant_tensor()?;
            Ok(released(py, || mesh::$name(&positions, &mesh.0)).map_err(Refusal::from)?)
        }
    )+};
}

measures! { surface_area signed_volume }

#[pyfunction]
pub fn self_intersections<'py>(
    py: Python<'py>,
    positions: Array<'py>,
    mesh: &Mesh,
) -> PyResult<Bound<'py, PyArray2<u32>>> {
    let positions = positions.constant_tensor()?;
    let pairs = released(py, || mesh::self_intersections(&positions, &mesh.0));
    let pairs = pairs.map_err(Refusal::from)?;
    PyArray1::from_slice(py, pairs.as_flattened()).reshape([pairs.len(), 2])
}

/// Indices and distances.
type Nearest<'py> = PyResult<(Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>)>;

#[pyfunction]
pub fn nearest_points<'py>(
    py: Python<'py>,
    queries: Array<'py>,
    points: Array<'py>,
) -> Nearest<'py> {
    let (queries, points) = (queries.constant_tensor()?, points.constant_tensor()?);
    let found = released(py, || mesh::nearest_points(&queries, &points)).map_err(Refusal::from)?;
    Ok((PyArray1::from_vec(py, found.indices), PyArray1::from_vec(py, found.distances)))
}

#[pyfunction]
#[expect(clippy::type_complexity, reason = "points, distances, faces, and weights of vertices")]
pub fn nearest_on_surface<'py>(
    py: Python<'py>,
    queries: Array<'py>,
    positions: Array<'py>,
    mesh: &Mesh,
) -> PyResult<(
    Bound<'py, PyArrayDyn<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<u32>>,
    Sparse,
)> {
    let (queries, positions) = (queries.constant_tensor()?, positions.constant_tensor()?);
    let found = released(py, || {
        let (found, distances) = mesh::nearest_on_surface(&queries, &positions, &mesh.0)?;
        let points = found.interpolated(&positions)?;
        Ok::<_, Refusal>((found, distances, points))
    });
    let (found, distances, points) = found?;
    Ok((
        to_array(py, points)?,
        PyArray1::from_vec(py, distances),
        PyArray1::from_slice(py, found.faces()),
        Sparse::from_matrix(found.weights().clone()),
    ))
}

#[pyfunction]
pub fn f_score(
    py: Python<'_>,
    found: Array<'_>,
    truth: Array<'_>,
    threshold: f64,
) -> PyResult<(f64, f64, f64)> {
    let (found, truth) = (found.constant_tensor()?, truth.constant_tensor()?);
    let score = released(py, || mesh::f_score(&found, &truth, threshold));
    let mesh::FScore { precision, recall, score } = score.map_err(Refusal::from)?;
    Ok((precision, recall, score))
}

#[pyfunction]
pub fn normal_consistency(
    py: Python<'_>,
    positions: Array<'_>,
    mesh: &Mesh,
    other_positions: Array<'_>,
    other_mesh: &Mesh,
    count: usize,
    seed: u64,
) -> PyResult<f64> {
    let [one, other] = [&positions, &other_positions].map(Array::constant_tensor);
    let (one, other) = (one?, other?);
    let alike = released(py, || {
        mesh::normal_consistency((&one, &mesh.0), (&other, &other_mesh.0), count, seed)
    });
    Ok(alike.map_err(Refusal::from)?)
}
