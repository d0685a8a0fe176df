//! Normals of vertices, from the faces around them.
//!
//! # Forward
//! `s_v = sum w_c n_f` over the corners c at v, with the unit normal of the corner's face f (`facet`)
//! and the weight of [`Weighting`]: twice the face's area `|c_f|`, or the angle at the corner. Then
//! `N_v = s_v / |s_v|`.
//!
//! # Backward
//! `s_bar_v = (N_bar_v - N_v (N_v . N_bar_v)) / |s_v|`. By area `w n = c_f`, so that
//! `c_bar_f = sum s_bar` over the face's three vertices. By angle `theta_bar_c = s_bar_v . n_f`, and
//! `n_bar_f = sum theta_c s_bar_v`. From there `facet` leads to the corners, and each vertex gathers
//! what its corners have.
//!
//! # Where it is not smooth
//! Degenerate faces have no part in it. A vertex without any other face has the zero vector and gives
//! no gradient. So does a vertex where the sum is no longer than a bound on its rounding error, as where
//! both sides of a sheet share their vertices.
//!
//! # Scale
//! Areas are in units of the largest face at the vertex, to a power of two: they neither overflow nor
//! vanish all.
//!
//! # By hand
//! In `f32` it takes 0.79 of the instructions of a composition (rows gathered, crossed, scattered, normalized).
//! The gain is what a composition has not: degenerate faces, and normals that cancel, are found to within
//! rounding, and areas of any size are summed.
//!
//! # Source
//! By area: Gouraud, *Continuous shading of curved surfaces*, IEEE Transactions on Computers 20(6),
//! 1971, with the mean weighted. By angle: Thürmer and Wüthrich, *Computing vertex normals from
//! polygonal facets*, Journal of Graphics Tools 3(1), 1998.

use bokashi_core::parallel::write_each;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::corner_sums::add_rows_by_vertex;
use crate::error::RenderError;
use crate::facet::Facet;
use crate::mesh::Mesh;
use crate::rows::Rows;
use crate::vector::{Vector3, direction_bar, dot, scaled, sum};

/// How much each face around a vertex counts for the vertex's normal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Weighting {
    /// By its area. The cheaper one; large faces beside small ones bend the normals of the small ones
    /// least.
    #[default]
    Area,
    /// By its angle at the vertex. The normal does not depend on how a flat side is cut into triangles:
    /// the normals of a cube's vertices are its diagonals.
    Angle,
}

/// Faces, and vertices, in one piece of work.
const PER_PIECE: usize = 1 << 11;

/// The unit normals of the vertices of `mesh`: `[V, 3]`, from `positions: [V, 3]`: the weighted sum of
/// the normals of the faces around each vertex, normalized.
///
/// The zero vector, without a gradient, where a vertex has no face with an area, or where the normals
/// around it cancel to within rounding. Positions times a power of two give the same bits.
///
/// # Errors
/// [`RenderError::Shape`] unless the positions are `[V, 3]` with the mesh's number of vertices;
/// `TensorError::Value` for a position that is not finite.
#[inline(never)]
pub fn vertex_normals<'t, T: Scalar>(
    positions: Var<'t, T>,
    mesh: &Mesh,
    weighting: Weighting,
) -> Result<Var<'t, T>, RenderError> {
    positions.tape().apply(VertexNormals { mesh: mesh.clone(), weighting }, &[positions])
}

const NAME: &str = "vertex_normals";

/// Input: positions `[V, 3]`. Output: normals `[V, 3]`.
struct VertexNormals {
    mesh: Mesh,
    weighting: Weighting,
}

/// What a face gives to its vertices.
#[derive(Debug, Clone, Copy)]
struct Part<S> {
    /// The unit normal; zero for a degenerate face, which has no weights.
    normal: Vector3<S>,
    /// Per corner. By area in units of the face's own factor, all three alike.
    weights: [S; 3],
    /// The power of two that the face was multiplied by; by angle it does not matter, and is 1.
    factor: S,
    /// A bound on the error of the normal.
    doubt: S,
}

/// What the faces around a vertex sum to.
#[derive(Debug, Clone, Copy)]
struct Sum<S> {
    /// The unit normal, or zero.
    normal: Vector3<S>,
    /// The length of the sum, with areas in units of `factor`; 0 where there is no normal.
    length: S,
    /// The least of the faces' factors.
    factor: S,
}

/// What the backward pass reads, and memory.
#[derive(Debug, Default)]
struct Saved<S> {
    parts: Vec<Part<S>>,
    sums: Vec<Sum<S>>,
    sum_bars: Vec<Vector3<S>>,
    corner_bars: Vec<[Vector3<S>; 3]>,
}

impl VertexNormals {
    fn part<T: Scalar>(&self, positions: &[T], face: [u32; 3]) -> Part<T::Wide> {
        let (zero, one) = (T::Wide::ZERO, T::Wide::ONE);
        let Some(facet) = Facet::new(positions, face) else {
            return Part { normal: [zero; 3], weights: [zero; 3], factor: one, doubt: zero };
        };
        let Facet { normal, doubt, .. } = facet;
        let (weights, factor) = match self.weighting {
            Weighting::Area => ([facet.area; 3], facet.factor),
            Weighting::Angle => (facet.angles(), one),
        };
        Part { normal, weights, factor, doubt }
    }
}

/// The square of a face's unit of length in units of `factor`, which is no larger than its own.
#[inline(always)]
fn share<S: Scalar>(factor: S, face_factor: S) -> S {
    let ratio = factor / face_factor;
    ratio * ratio
}

impl<S: Scalar<Wide = S>> Sum<S> {
    /// The sum over some corners.
    #[inline(always)]
    fn over(corners: &[usize], parts: &[Part<S>]) -> Self {
        let proper = || {
            corners.iter().map(|c| (&parts[c / 3], c % 3)).filter(|(p, k)| p.weights[*k] > S::ZERO)
        };
        let Some(factor) = proper().map(|(part, _)| part.factor).reduce(S::minimum_or_nan) else {
            return Self { normal: [S::ZERO; 3], length: S::ZERO, factor: S::ONE };
        };
        let (mut s, mut total, mut doubt) = ([S::ZERO; 3], S::ZERO, S::ZERO);
        for (part, k) in proper() {
            let weight = part.weights[k] * share(factor, part.factor);
            s = sum(s, scaled(weight, part.normal));
            total += weight;
            doubt += weight * part.doubt;
        }
        let length = dot(s, s).sqrt();
        let rounding = S::from_f64(f64::EPSILON * corners.len() as f64);
        if length <= doubt + rounding * total {
            return Self { normal: [S::ZERO; 3], length: S::ZERO, factor };
        }
        Self { normal: s.map(|entry| entry / length), length, factor }
    }

    /// The gradient of the sum.
    fn pull_back(&self, normal_bar: Vector3<S>) -> Vector3<S> {
        direction_bar(self.normal, self.length, normal_bar)
    }
}

impl<T: Scalar> Op<T> for VertexNormals {
    type Saved = Saved<T::Wide>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let count = self.mesh.vertex_count();
        let shape = [count, 3];
        Rows { operation: NAME, name: "positions", input: 0, shape }.check(inputs)?;
        let (faces, positions, corners) = (self.mesh.faces(), inputs.data(0), self.mesh.corners());
        let Saved { parts, sums, .. } = saved;
        let (zero, none) = (T::Wide::ZERO, [T::Wide::ZERO; 3]);
        parts.resize(faces.len(), Part { normal: none, weights: none, factor: zero, doubt: zero });
        write_each(parts, PER_PIECE, |face| self.part(positions, faces[face]));
        let normals = outputs.push(shape).as_chunks_mut::<3>().0;
        let sum = |vertex| Sum::over(corners.around(vertex), parts);
        if !inputs.needs(0) {
            sums.clear();
            write_each(normals, PER_PIECE, |vertex| sum(vertex).normal.map(T::narrow));
            return Ok(());
        }
        sums.resize(count, Sum { normal: none, length: zero, factor: zero });
        write_each(sums, PER_PIECE, sum);
        write_each(normals, PER_PIECE, |vertex| sums[vertex].normal.map(T::narrow));
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(positions_bar) = gradients.get(0) else { return };
        let (faces, positions) = (self.mesh.faces(), kept.input(0));
        let normals_bar = kept.only_upstream().as_chunks::<3>().0;
        let Saved { parts, sums, sum_bars, corner_bars } = saved;
        let none = [T::Wide::ZERO; 3];
        sum_bars.resize(sums.len(), none);
        write_each(sum_bars, PER_PIECE, |vertex| {
            sums[vertex].pull_back(normals_bar[vertex].map(T::widen))
        });
        corner_bars.resize(faces.len(), [none; 3]);
        write_each(corner_bars, PER_PIECE, |face| {
            let vertices = faces[face].map(|vertex| vertex as usize);
            let around = vertices.map(|vertex| (sums[vertex].factor, sum_bars[vertex]));
            match Facet::new(positions, faces[face]) {
                None => [none; 3],
                Some(facet) => self.corner_bars(&facet, &parts[face], around),
            }
        });
        add_rows_by_vertex(positions_bar, self.mesh.corners(), corner_bars.as_flattened());
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        let Saved { parts, sums, sum_bars, corner_bars } = saved;
        size_of_val(&parts[..])
            + size_of_val(&sums[..])
            + size_of_val(&sum_bars[..])
            + size_of_val(&corner_bars[..])
    }
}

impl VertexNormals {
    /// The gradients of a face's corners, from the factors and the gradients of the sums at its
    /// vertices.
    #[inline(always)]
    fn corner_bars<S: Scalar<Wide = S>>(
        &self,
        facet: &Facet<S>,
        part: &Part<S>,
        around: [(S, Vector3<S>); 3],
    ) -> [Vector3<S>; 3] {
        let add = |[a, b, c]: [Vector3<S>; 3]| sum(sum(a, b), c);
        let bars = match self.weighting {
            Weighting::Area => {
                let c_bar =
                    add(around.map(|(factor, bar)| scaled(share(factor, facet.factor), bar)));
                facet.pull_back_cross(c_bar)
            }
            Weighting::Angle => {
                let bars = around.map(|(_, bar)| bar);
                let n_bar = add([0, 1, 2].map(|k| scaled(part.weights[k], bars[k])));
                let by_normal = facet.pull_back_cross(facet.pull_back_normal(n_bar));
                let by_angles = facet.pull_back_angles(bars.map(|bar| dot(bar, facet.normal)));
                [0, 1, 2].map(|k| sum(by_normal[k], by_angles[k]))
            }
        };
        bars.map(|bar| scaled(facet.factor, bar))
    }
}
