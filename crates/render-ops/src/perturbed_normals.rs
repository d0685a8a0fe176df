//! Normals perturbed by a map: a normal map in tangent space.
//!
//! # Forward
//! `m = n / |n|`, `d = q / |q|` with `q = t - m (m . t)`, `b = w (m x d)` with the sign w of the
//! tangent's fourth number, `r = x d + y b + z m`, and `y = r / |r|`. As d, b and m are orthonormal, a
//! map value turns with the surface and keeps its length.
//!
//! # Backward
//! From `y_bar` to `r_bar` as for any direction (`vector`);
//! `(x, y, z)_bar = (d . r_bar, b . r_bar, m . r_bar)`, `b_bar = y r_bar`,
//! `d_bar = x r_bar + w (b_bar x m)`, `q_bar` as for any direction, `t_bar = q_bar - m (m . q_bar)`,
//! `m_bar = z r_bar + w (d x b_bar) - (m . t) q_bar - (m . q_bar) t`. The sign has no gradient.
//!
//! # Where it is not smooth
//! Where there is no tangent across the normal, to within rounding, the result is m whatever the map
//! says. Where the normal or the map value is zero, the result is zero, without a gradient.
//!
//! # Source
//! Blinn, *Simulation of wrinkled surfaces*, SIGGRAPH 1978; the conventions are those of glTF 2.0,
//! section 3.9.3.

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::error::RenderError;
use crate::row_map::{add_rows, map_rows};
use crate::vector::{
    Direction, ROUNDING, Vector3, across, cross, difference, dot, largest, power_of_two_to_1,
    scaled, sum,
};

/// The unit vectors that `values: [N, 3]` of a normal map stand for on a surface with `normals: [N, 3]`
/// and `tangents: [N, 4]`: `x t + y b + z n`, normalized, in the orthonormal frame of tangent, bitangent
/// and normal. The axes before the last one can be any.
///
/// Map values are already in `[-1, 1]`, x along the tangent, y along the bitangent, upwards in the
/// texture, z along the normal: `2 c - 1` of a colour c of a normal map of glTF. Tangents are those of
/// [`tangents`](crate::tangents()), interpolated: the vector need be neither long nor exactly across the
/// normal, and of the fourth number the sign counts, from 0 up as +1.
///
/// Where there is no tangent, the result is the unit normal. Where the normal or the map value is zero,
/// it is zero, without a gradient. Lengths do not matter, and the tangent's fourth number has no
/// gradient.
///
/// # Errors
/// [`RenderError::Shape`] unless the shapes are `[.., 3]`, `[.., 4]` and `[.., 3]` with the same axes
/// before the last.
#[inline(never)]
pub fn perturbed_normals<'t, T: Scalar>(
    normals: Var<'t, T>,
    tangents: Var<'t, T>,
    values: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    normals.tape().apply(PerturbedNormals, &[normals, tangents, values])
}

const NAME: &str = "perturbed_normals";

/// Inputs: normals `[.., 3]`, tangents `[.., 4]`, map values `[.., 3]`.
struct PerturbedNormals;

/// A row of the inputs.
type Row<'a, T> = (&'a [T; 3], &'a [T; 4], &'a [T; 3]);

/// A row's frame, and its map value in it.
struct Frame<S> {
    normal: Direction<S>,
    tangent: Option<Tangent<S>>,
}

struct Tangent<S> {
    /// The tangent times a power of two, and that power.
    t: Vector3<S>,
    factor: S,
    /// Across the normal.
    direction: Direction<S>,
    bitangent: Vector3<S>,
    /// The fourth number.
    sign: S,
    /// The map value times a power of two, and that power.
    value: Vector3<S>,
    value_factor: S,
    /// Of the perturbed normal; `None` where the map value is zero.
    perturbed: Option<Direction<S>>,
}

/// Gradients of a row's normal, tangent and map value.
type Bars<S> = [Vector3<S>; 3];

impl<S: Scalar<Wide = S>> Frame<S> {
    /// `None` where the normal is zero.
    #[inline(always)]
    fn new<T: Scalar<Wide = S>>((normal, tangent, value): Row<'_, T>) -> Option<Self> {
        let normal = Direction::new(normal.map(T::widen))?;
        let m = normal.unit;
        let [x, y, z, w] = tangent.map(T::widen);
        let factor = power_of_two_to_1(largest([x, y, z]));
        let t = scaled(factor, [x, y, z]);
        let error = S::from_f64(ROUNDING) * (t[0].abs() + t[1].abs() + t[2].abs());
        let tangent = Direction::beyond(across(m, t), error).map(|direction| {
            let d = direction.unit;
            let sign = if w < S::ZERO { -S::ONE } else { S::ONE };
            let bitangent = scaled(sign, cross(m, d));
            let value = value.map(T::widen);
            let value_factor = power_of_two_to_1(largest(value));
            let value = scaled(value_factor, value);
            let in_plane = sum(scaled(value[0], d), scaled(value[1], bitangent));
            let perturbed = Direction::new(sum(in_plane, scaled(value[2], m)));
            Tangent { t, factor, direction, bitangent, sign, value, value_factor, perturbed }
        });
        Some(Self { normal, tangent })
    }

    /// The perturbed normal; `None` where it is zero.
    #[inline(always)]
    fn result(&self) -> Option<Vector3<S>> {
        match &self.tangent {
            Some(tangent) => tangent.perturbed.map(|direction| direction.unit),
            None => Some(self.normal.unit),
        }
    }

    #[inline(always)]
    fn pull_back(&self, result_bar: Vector3<S>) -> Option<Bars<S>> {
        let none = [S::ZERO; 3];
        let Some(tangent) = &self.tangent else {
            return Some([self.normal.pull_back(result_bar), none, none]);
        };
        let Tangent { t, direction, bitangent, sign, value: [x, y, z], .. } = *tangent;
        let (m, d) = (self.normal.unit, direction.unit);
        let r_bar = tangent.perturbed?.pull_back(result_bar);
        let value_bar = [dot(d, r_bar), dot(bitangent, r_bar), dot(m, r_bar)];
        let b_bar = scaled(sign * y, r_bar);
        let q_bar = direction.pull_back(sum(scaled(x, r_bar), cross(b_bar, m)));
        let m_bar = difference(
            sum(scaled(z, r_bar), cross(d, b_bar)),
            sum(scaled(dot(m, t), q_bar), scaled(dot(m, q_bar), t)),
        );
        Some([
            self.normal.pull_back(m_bar),
            scaled(tangent.factor, across(m, q_bar)),
            scaled(tangent.value_factor, value_bar),
        ])
    }
}

impl<T: Scalar> Op<T> for PerturbedNormals {
    /// Memory: the gradients of each row's inputs, nine numbers.
    type Saved = Vec<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let shape = inputs.shape(0);
        let refused = |rule: String, input: usize| {
            let shape = inputs.shape(input).clone();
            Err(RenderError::Shape { operation: NAME, rule, shape })
        };
        let Some((3, leading)) = shape.split_last() else {
            return refused("normals of shape [.., 3]".to_owned(), 0);
        };
        for (input, name, width) in [(1, "tangents", 4), (2, "map values", 3)] {
            let Some((last, other)) = inputs.shape(input).split_last() else {
                return refused(format!("{name} of shape [.., {width}]"), input);
            };
            if (*last, other) != (width, leading) {
                let mut expected = leading.to_vec();
                expected.push(width);
                return refused(format!("{name} of shape {expected:?}"), input);
            }
        }
        let rows = rows([0, 1, 2].map(|i| inputs.data(i)));
        map_rows::<T, 3>(outputs.push(shape), |row| Frame::new(rows(row))?.result());
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1).input(2)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        bars: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let rows = rows([0, 1, 2].map(|i| kept.input(i)));
        let result_bars = kept.only_upstream().as_chunks::<3>().0;
        bars.resize(9 * result_bars.len(), T::ZERO);
        map_rows::<T, 9>(bars, |row| {
            let all = Frame::new(rows(row))?.pull_back(result_bars[row].map(T::widen))?;
            all.as_flattened().try_into().ok()
        });
        let bars = bars.as_chunks::<9>().0;
        let bar = |input: usize, row: usize| [0, 1, 2].map(|k| bars[row][3 * input + k].widen());
        for input in [0, 2] {
            let Some(gradient) = gradients.get(input) else { continue };
            add_rows::<T, 3>(gradient, |row| Some(bar(input, row)));
        }
        if let Some(gradient) = gradients.get(1) {
            add_rows::<T, 4>(gradient, |row| {
                let [x, y, z] = bar(1, row);
                Some([x, y, z, T::Wide::ZERO])
            });
        }
    }

    fn saved_bytes(&self, bars: &Self::Saved) -> usize {
        size_of_val(&bars[..])
    }
}

/// The rows of the inputs by their index.
fn rows<'a, T>(data: [&'a [T]; 3]) -> impl Fn(usize) -> Row<'a, T> {
    let [normals, tangents, values] = data;
    let normals = normals.as_chunks::<3>().0;
    let (tangents, values) = (tangents.as_chunks::<4>().0, values.as_chunks::<3>().0);
    move |row| (&normals[row], &tangents[row], &values[row])
}
