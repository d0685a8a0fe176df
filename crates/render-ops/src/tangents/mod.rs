//! Tangents of a textured mesh: the directions in which the texture's columns grow.
//!
//! # Forward
//! `s_a = sum phi_c d_c` over the corners c at texture coordinate a (`textured`): d is the direction in
//! which u grows on the corner's face, in the plane across the vertex's normal, and phi the corner's
//! angle in that plane. Where the faces at a disagree about whether the texture is mirrored, those
//! count whose angles sum to more. `T_a = s_a / |s_a|`, and a fourth number, the bitangent's sign: +1,
//! or -1 where the texture is mirrored.
//!
//! # Backward
//! `s_bar_a = (T_bar_a - T_a (T_a . T_bar_a)) / |s_a|`, `d_bar_c = phi_c s_bar_a`,
//! `phi_bar_c = d_c . s_bar_a`, and from there to the corners of each face (`textured`). The direction
//! of u is the one along which v stays: the gradient of u is zero. The sign has none.
//!
//! # Where it is not smooth
//! Where another side prevails; and where a face is seen edge-on along a normal, at which its angle has
//! a kink. Where s is no longer than a bound on its rounding error, or no corner sees a direction,
//! there is no tangent: T is zero, the sign +1, and there is no gradient.
//!
//! # Source
//! Mikkelsen, *Simulation of wrinkled surfaces revisited*, 2008, whose weights and directions these
//! are. He gives faces of either side tangents of their own; here the mesh has to separate them.

mod textured;

use bokashi_core::parallel::write_each;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, TensorError, Var};

use self::textured::{Bars, CornerTangentBar, Textured};
use crate::corner_sums::{add_by_vertex, sum_over};
use crate::error::RenderError;
use crate::mesh::Mesh;
use crate::rows::Rows;
use crate::vector::{Direction, Vector3, direction_bar, dot, scaled, sum};

/// Faces, and texture coordinates, in one piece of work.
const PER_PIECE: usize = 1 << 10;

/// Tangents `[A, 4]` of a textured mesh, one for each texture coordinate: the unit vector across the
/// vertex's normal along which u grows, and the sign of the bitangent, +1 or -1. The bitangent is
/// `sign (n x t)`, and v *falls* along it, as in glTF: see `docs/notation.md`.
///
/// `positions` and `normals`, of any length, are `[V, 3]` with the vertices of `mesh`. `coordinates` are
/// `[A, 2]`, pairs (u, v). Face k of `indices` names the coordinates of face k of `mesh`; where both are
/// the same, give it twice. Interpolate the tangents with `indices`, too
/// ([`interpolate_indexed`](crate::interpolate_indexed())), and perturb normals with them
/// ([`perturbed_normals`](crate::perturbed_normals())).
///
/// Where no face has a direction of u, since its coordinates or its corners are on a line to within
/// rounding, where the directions cancel, and where the normal is zero, the tangent is `(0, 0, 0, 1)`,
/// without a gradient. Where some faces at a coordinate show the texture mirrored and others don't,
/// those count that fill more of the angle: give the sides of a mirrored texture coordinates of their
/// own. Factors of positions, normals or coordinates that are powers of two change no bit.
///
/// # Errors
/// - [`RenderError::Shape`] for inputs of other shapes.
/// - [`RenderError::FaceCount`] unless `indices` has as many faces as `mesh`.
/// - `TensorError::Value` for a number that is not finite, and for a texture coordinate that stands at
///   more than one vertex.
#[inline(never)]
pub fn tangents<'t, T: Scalar>(
    positions: Var<'t, T>,
    normals: Var<'t, T>,
    coordinates: Var<'t, T>,
    indices: &Mesh,
    mesh: &Mesh,
) -> Result<Var<'t, T>, RenderError> {
    let [expected, given] = [mesh, indices].map(|mesh| mesh.faces().len());
    if given != expected {
        return Err(RenderError::FaceCount { expected, given });
    }
    let op = Tangents { mesh: mesh.clone(), indices: indices.clone() };
    positions.tape().apply(op, &[positions, normals, coordinates])
}

const NAME: &str = "tangents";

/// Inputs: positions `[V, 3]`, normals `[V, 3]`, coordinates `[A, 2]`. Output: tangents `[A, 4]`.
struct Tangents {
    mesh: Mesh,
    indices: Mesh,
}

/// What a face gives to the texture coordinates at its corners.
#[derive(Debug, Clone, Copy)]
struct Part<S> {
    /// Angles; 0 where a corner sees nothing.
    weights: [S; 3],
    directions: [Vector3<S>; 3],
    doubts: [S; 3],
    is_mirrored: bool,
}

/// What the faces at a texture coordinate sum to.
#[derive(Debug, Clone, Copy)]
struct Sum<S> {
    /// The unit tangent, or zero.
    tangent: Vector3<S>,
    /// The length of the sum; 0 where there is no tangent.
    length: S,
    /// Of the faces that were summed.
    is_mirrored: bool,
}

/// What the backward pass reads, and memory.
#[derive(Debug, Default)]
struct Saved<S> {
    parts: Vec<Part<S>>,
    sums: Vec<Sum<S>>,
    sum_bars: Vec<Vector3<S>>,
    bars: Vec<Bars<S>>,
    /// The vertex at which each texture coordinate stands.
    vertices: Vec<u32>,
}

/// Stands for a texture coordinate that no face names.
const NOWHERE: u32 = u32::MAX;

impl Tangents {
    /// Checks that each texture coordinate stands at one vertex.
    fn check_places(&self, vertices: &mut Vec<u32>) -> Result<(), RenderError> {
        if self.indices.is(&self.mesh) {
            return Ok(());
        }
        vertices.clear();
        vertices.resize(self.indices.vertex_count(), NOWHERE);
        let named = self.indices.faces().as_flattened().iter();
        for (&coordinate, &vertex) in named.zip(self.mesh.faces().as_flattened()) {
            let entry = &mut vertices[coordinate as usize];
            if *entry != NOWHERE && *entry != vertex {
                let rule =
                    format!("texture coordinate {coordinate} at no vertex but {entry}").into();
                let value = f64::from(vertex);
                return Err(TensorError::Value { operation: NAME, rule, value }.into());
            }
            *entry = vertex;
        }
        Ok(())
    }

    /// A face with its texture.
    #[inline(always)]
    fn textured<T: Scalar>(&self, inputs: [&[T]; 3], face: usize) -> Option<Textured<T::Wide>> {
        Textured::new(inputs, self.mesh.faces()[face], self.indices.faces()[face])
    }

    fn part<T: Scalar>(&self, inputs: [&[T]; 3], face: usize) -> Part<T::Wide> {
        let mut part = Part::nothing();
        let Some(textured) = self.textured(inputs, face) else { return part };
        part.is_mirrored = textured.is_mirrored;
        for k in 0..3 {
            if let Some(tangent) = textured.corner_tangent(k) {
                part.weights[k] = tangent.angle();
                part.directions[k] = tangent.direction();
                part.doubts[k] = tangent.doubt;
            }
        }
        part
    }

    /// The gradients of the corners of a face, from those of the sums.
    #[inline(always)]
    fn bars<T: Scalar>(
        &self,
        inputs: [&[T]; 3],
        face: usize,
        part: &Part<T::Wide>,
        sums: &[Sum<T::Wide>],
        sum_bars: &[Vector3<T::Wide>],
    ) -> Bars<T::Wide> {
        let Some(textured) = self.textured(inputs, face) else { return Bars::ZERO };
        let named = self.indices.faces()[face].map(|coordinate| coordinate as usize);
        textured.pull_back([0, 1, 2].map(|k| {
            let (sum, sum_bar) = (&sums[named[k]], sum_bars[named[k]]);
            if sum.length == T::Wide::ZERO || sum.is_mirrored != textured.is_mirrored {
                return None;
            }
            let tangent = textured.corner_tangent(k)?;
            let direction_bar = scaled(part.weights[k], sum_bar);
            let angle_bar = dot(tangent.direction(), sum_bar);
            Some((tangent, CornerTangentBar { direction_bar, angle_bar }))
        }))
    }
}

impl<S: Scalar> Part<S> {
    fn nothing() -> Self {
        let zeros = [S::ZERO; 3];
        Self { weights: zeros, directions: [zeros; 3], doubts: zeros, is_mirrored: false }
    }
}

impl<S: Scalar> Sum<S> {
    fn nothing() -> Self {
        Self { tangent: [S::ZERO; 3], length: S::ZERO, is_mirrored: false }
    }

    /// The sum over some corners.
    #[inline(always)]
    fn over(corners: &[usize], parts: &[Part<S>]) -> Self {
        let part_of = |corner: usize| (&parts[corner / 3], corner % 3);
        let mut angles = [S::ZERO; 2];
        for &corner in corners {
            let (part, k) = part_of(corner);
            angles[usize::from(part.is_mirrored)] += part.weights[k];
        }
        let is_mirrored = angles[1] > angles[0];
        let (mut s, mut doubt) = ([S::ZERO; 3], S::ZERO);
        for &corner in corners {
            let (part, k) = part_of(corner);
            if part.is_mirrored == is_mirrored && part.weights[k] > S::ZERO {
                s = sum(s, scaled(part.weights[k], part.directions[k]));
                doubt += part.weights[k] * part.doubts[k];
            }
        }
        let length = dot(s, s).sqrt();
        let total = angles[usize::from(is_mirrored)];
        let rounding = S::from_f64(f64::EPSILON * corners.len() as f64);
        if length <= doubt + rounding * total {
            return Self::nothing();
        }
        Self { tangent: s.map(|entry| entry / length), length, is_mirrored }
    }

    /// The gradient of the sum.
    fn pull_back(&self, tangent_bar: Vector3<S>) -> Vector3<S> {
        direction_bar(self.tangent, self.length, tangent_bar)
    }

    fn row<T: Scalar<Wide = S>>(&self) -> [T; 4] {
        let [x, y, z] = self.tangent.map(T::narrow);
        [x, y, z, if self.is_mirrored { -T::ONE } else { T::ONE }]
    }
}

impl<T: Scalar> Op<T> for Tangents {
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
        let (vertices, count) = (self.mesh.vertex_count(), self.indices.vertex_count());
        let rules = [
            ("positions", [vertices, 3]),
            ("normals", [vertices, 3]),
            ("texture coordinates", [count, 2]),
        ];
        for (input, (name, shape)) in rules.into_iter().enumerate() {
            Rows { operation: NAME, name, input, shape }.check(inputs)?;
        }
        self.check_places(&mut saved.vertices)?;
        let Saved { parts, sums, .. } = saved;
        let data = [0, 1, 2].map(|i| inputs.data(i));
        parts.resize(self.mesh.faces().len(), Part::nothing());
        write_each(parts, PER_PIECE, |face| self.part(data, face));
        let corners = self.indices.corners();
        let tangents = outputs.push([count, 4]).as_chunks_mut::<4>().0;
        sums.resize(count, Sum::nothing());
        write_each(sums, PER_PIECE, |coordinate| Sum::over(corners.around(coordinate), parts));
        write_each(tangents, PER_PIECE, |coordinate| sums[coordinate].row());
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1).input(2)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let data = [0, 1, 2].map(|i| kept.input(i));
        let tangents_bar = kept.only_upstream().as_chunks::<4>().0;
        let Saved { parts, sums, sum_bars, bars, .. } = saved;
        sum_bars.resize(sums.len(), [T::Wide::ZERO; 3]);
        write_each(sum_bars, PER_PIECE, |coordinate| {
            let [x, y, z, _] = tangents_bar[coordinate].map(T::widen);
            sums[coordinate].pull_back([x, y, z])
        });
        bars.resize(self.mesh.faces().len(), Bars::ZERO);
        write_each(bars, PER_PIECE, |face| self.bars(data, face, &parts[face], sums, sum_bars));
        if let Some(positions_bar) = gradients.get(0) {
            add_by_vertex(positions_bar, self.mesh.corners(), |_, corners| {
                sum_over(corners, |corner| bars[corner / 3].positions[corner % 3])
            });
        }
        if let Some(normals_bar) = gradients.get(1) {
            let normals = data[1].as_chunks::<3>().0;
            add_by_vertex(normals_bar, self.mesh.corners(), |vertex, corners| {
                let bar = sum_over(corners, |corner| bars[corner / 3].normals[corner % 3]);
                let direction = Direction::new(normals[vertex].map(T::widen));
                direction.map_or([T::Wide::ZERO; 3], |direction| direction.pull_back(bar))
            });
        }
        if let Some(coordinates_bar) = gradients.get(2) {
            add_by_vertex(coordinates_bar, self.indices.corners(), |_, corners| {
                sum_over(corners, |corner| bars[corner / 3].coordinates[corner % 3])
            });
        }
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        let Saved { parts, sums, sum_bars, bars, vertices } = saved;
        size_of_val(&parts[..])
            + size_of_val(&sums[..])
            + size_of_val(&sum_bars[..])
            + size_of_val(&bars[..])
            + size_of_val(&vertices[..])
    }
}
