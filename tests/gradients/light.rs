//! Light on surfaces: shading, environments, mirrored directions and tone curves.

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Environment, Light, Material, Prefilter, Surface, exposure, irradiance, reflect, shade,
    srgb_decode, srgb_encode,
};
use glam::DVec3;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::rendering::{check, leaf, wide};
use crate::scenes::motley;

/// A model of reflection.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Model {
    MetallicRoughness { conserves_energy: bool },
    Lambert,
    Phong,
    BlinnPhong,
}

impl Model {
    /// The numbers of each part of its material.
    fn widths(self) -> &'static [usize] {
        match self {
            Self::MetallicRoughness { .. } => &[3, 1, 1],
            Self::Lambert => &[3],
            Self::Phong | Self::BlinnPhong => &[3, 3, 1],
        }
    }

    fn material<'t, T: Scalar>(self, parts: &[Var<'t, T>]) -> Material<'t, T> {
        match (self, parts) {
            (Self::MetallicRoughness { conserves_energy }, &[base_color, roughness, metallic]) => {
                Material::MetallicRoughness { base_color, roughness, metallic, conserves_energy }
            }
            (Self::Lambert, &[color]) => Material::Lambert { color },
            (Self::Phong, &[color, specular, exponent]) => {
                Material::Phong { color, specular, exponent }
            }
            (Self::BlinnPhong, &[color, specular, exponent]) => {
                Material::BlinnPhong { color, specular, exponent }
            }
            _ => unreachable!("each model has its parts"),
        }
    }

    /// A material of `rows` rows, or for all rows; numbers in (0, 1), none of them near what is
    /// clamped.
    fn inputs(self, rows: Option<usize>) -> BoxedStrategy<Vec<Tensor<f64>>> {
        let highlights = matches!(self, Self::Phong | Self::BlinnPhong);
        let widths = self.widths();
        let count = rows.unwrap_or(1);
        let parts: Vec<_> = widths
            .iter()
            .enumerate()
            .map(move |(k, &width)| {
                // An exponent below 2 has a kink where the highlight ends.
                let numbers = if highlights && k == 2 { 2.5..9.0 } else { 0.25..0.9 };
                vec(numbers, width * count).prop_map(move |entries| {
                    let axes: Vec<_> =
                        rows.into_iter().chain((width > 1).then_some(width)).collect();
                    Tensor::new(&axes[..], entries).unwrap()
                })
            })
            .collect();
        parts.boxed()
    }
}

#[derive(Debug, Clone, Copy)]
struct Shade {
    model: Model,
}

/// On which side of a kink each row is, for light from `l`.
fn sides(n: DVec3, v: DVec3, l: DVec3) -> [bool; 5] {
    let (n, v, l) = (n.normalize(), v.normalize(), l.normalize());
    let mirrored = 2.0 * n.dot(l) * n.dot(v) - l.dot(v);
    [n.dot(l) > 0.0, n.dot(v) > 1e-4, mirrored > 0.0, n.dot(l + v) > 0.0, (l + v).length() > 1e-4]
}

impl Subject for Shade {
    /// Normals, views, positions, a direction, an irradiance, a light's position, an intensity, a
    /// radiance, and the material.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let &[normals, views, positions, direction, irradiance, position, intensity, radiance, ..] =
            inputs
        else {
            return Err("eight inputs and a material".into());
        };
        let surface = Surface { normals, views, positions: Some(positions) };
        let lights = [
            Light::Directional { direction, irradiance },
            Light::Point { position, intensity },
            Light::Ambient { radiance },
        ];
        let out = shade(&surface, &self.model.material(&inputs[8..]), &lights)?;
        let row = |tensor: &Tensor<f64>, k: usize| {
            DVec3::from_slice(&tensor.data()[3 * k % tensor.size()..])
        };
        let [n, v, p, l, lamp] = [normals, views, positions, direction, position].map(wide);
        let states = (0..n.size() / 3).map(|k| {
            let (n, v) = (row(&n, k), row(&v, k));
            [sides(n, v, row(&l, 0)), sides(n, v, row(&lamp, 0) - row(&p, k))]
        });
        Ok(Outcome::from(out).with_state(states.collect::<Vec<_>>()))
    }
}

const ROWS: usize = 4;

fn leaves(tensors: impl IntoIterator<Item = Tensor<f64>>) -> Vec<Input> {
    tensors.into_iter().map(Input::leaf).collect()
}

/// Vectors that are neither short nor long.
fn vectors(count: usize) -> BoxedStrategy<Tensor<f64>> {
    let vector = vec(-1.0..1.0_f64, 3)
        .prop_filter("a length", |d| d.iter().map(|x| x * x).sum::<f64>() > 0.1);
    let entries = vec(vector, count);
    entries.prop_map(move |all| Tensor::from_flat_fn([count, 3], |k| all[k / 3][k % 3])).boxed()
}

/// Normals and views: mostly an eye before the surface, sometimes behind it.
fn facing(count: usize) -> BoxedStrategy<[Tensor<f64>; 2]> {
    // Nearly at right angles to the normal, or along it, a difference quotient has no step.
    let is_clear = |n: &[f64], v: &[f64]| {
        let cosine = DVec3::from_slice(n).normalize().dot(DVec3::from_slice(v).normalize());
        (0.1..0.99).contains(&cosine.abs())
    };
    let are_clear = move |[n, v]: &[Tensor<f64>; 2]| {
        n.data().chunks(3).zip(v.data().chunks(3)).all(|(n, v)| is_clear(n, v))
    };
    let before = |[n, v]: [Tensor<f64>; 2], behind: bool| {
        let turned = Tensor::from_flat_fn(v.shape(), |k| {
            let row = 3 * (k / 3)..3 * (k / 3) + 3;
            let cosine: f64 =
                n.data()[row.clone()].iter().zip(&v.data()[row]).map(|(n, v)| n * v).sum();
            if (cosine < 0.0) == (behind && k < 3) { v.data()[k] } else { -v.data()[k] }
        });
        [n, turned]
    };
    let both = [vectors(count), vectors(count)].prop_filter("at a right angle", are_clear);
    (both, select(&[false, false, false, true][..]))
        .prop_map(move |(both, behind)| before(both, behind))
        .boxed()
}

fn flat(tensor: Tensor<f64>) -> Tensor<f64> {
    Tensor::new([3], tensor.data().to_vec()).unwrap()
}

const MODELS: [(&str, Model); 5] = [
    ("metallic-roughness", Model::MetallicRoughness { conserves_energy: false }),
    (
        "metallic-roughness that conserves energy",
        Model::MetallicRoughness { conserves_energy: true },
    ),
    ("Lambert", Model::Lambert),
    ("Phong", Model::Phong),
    ("Blinn-Phong", Model::BlinnPhong),
];

fn strengths() -> impl Strategy<Value = Tensor<f64>> {
    vec(0.1..2.0_f64, 3).prop_map(|entries| Tensor::new([3], entries).unwrap())
}

#[test]
fn shade_in_all_lights_of_all_materials() {
    for (name, model) in MODELS {
        let rows = select(&[Some(ROWS), None][..]);
        let cases = rows.prop_flat_map(move |rows| {
            let lights = (vectors(1), strengths(), vectors(1), strengths(), strengths());
            let all = (facing(ROWS), vectors(ROWS), lights, model.inputs(rows));
            all.prop_map(move |([n, v], p, (l, e, at, i, a), material)| {
                // The point is outside of all positions.
                let at = flat(at.map(|x| 4.0 * x));
                let inputs = [n, v, p.map(|x| 0.2 * x), flat(l), e, at, i, a];
                Case::new(Shade { model }, leaves(inputs.into_iter().chain(material)))
            })
        });
        let of = |change: usize, with: Input| {
            let rows = |k: usize| Input::leaf(Tensor::from_flat_fn([2, 3], |i| motley(i + k)));
            let three = |x: f64| leaf([3], x);
            let parts = model
                .widths()
                .iter()
                .map(|&width| if width > 1 { three(0.5) } else { leaf([], 0.5) });
            let mut inputs = vec![
                rows(1),
                rows(9),
                rows(4),
                three(0.3),
                three(1.0),
                three(3.0),
                three(1.0),
                three(1.0),
            ];
            inputs.extend(parts);
            inputs[change] = with;
            Case::new(Shade { model }, inputs)
        };
        check(
            Check::of_cases(format!("shade, {name}"), cases)
                .large(1, Just(many(model)))
                .refuses("normals of two", of(0, leaf([2, 2], 1.0)))
                .refuses("views of other rows", of(1, leaf([3, 3], 1.0)))
                .refuses_midway("a normal of no length", of(0, leaf([2, 3], 0.0)))
                .refuses_midway("a position that is no number", of(2, leaf([2, 3], f64::NAN)))
                .refuses("a negative irradiance", of(4, leaf([3], -1.0)))
                .refuses("a direction of no length", of(3, leaf([3], 0.0))),
        );
    }
}

/// More rows than a piece of work holds, and not in whole blocks.
fn many(model: Model) -> Case {
    let count = 4500;
    let rows = |k: usize, shift: [f64; 3]| {
        Tensor::from_flat_fn([count, 3], |i| 0.5 * motley(7 * i + k) + shift[i % 3])
    };
    let three = |entries: [f64; 3]| Tensor::from(entries);
    let above = [0.0, 0.0, 1.0];
    let mut inputs = vec![
        rows(1, above),
        rows(2, above),
        rows(3, [0.0; 3]),
        three([0.2, 0.3, 1.0]),
        three([1.0, 0.8, 0.6]),
        three([0.4, -0.5, 3.0]),
        three([2.0, 3.0, 4.0]),
        three([0.3, 0.2, 0.1]),
    ];
    for (k, &width) in model.widths().iter().enumerate() {
        let scale = if k == 2 && width == 1 && model.widths()[1] == 3 { 5.0 } else { 0.5 };
        let entry = move |i: usize| scale * (0.5 + 0.4 * motley(5 * i + k));
        inputs.push(match width {
            1 => Tensor::from_flat_fn([count], entry),
            _ => Tensor::from_flat_fn([count, width], entry),
        });
    }
    Case::new(Shade { model }, leaves(inputs))
}

#[derive(Debug)]
struct Irradiance;

impl Subject for Irradiance {
    /// Coefficients and normals.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(irradiance(inputs[0], inputs[1])?.into())
    }
}

#[test]
fn irradiance_of_coefficients_and_normals() {
    let of = |coefficients: Input, normals: Input| Case::new(Irradiance, [coefficients, normals]);
    let cases = (1..4_usize).prop_flat_map(move |channels| {
        let inputs = (tensor([9, channels], number()), vectors(ROWS));
        inputs.prop_map(move |(coefficients, normals)| {
            of(Input::leaf(coefficients), Input::leaf(normals))
        })
    });
    let rows = |extents: [usize; 2], k: usize| {
        Input::leaf(Tensor::from_flat_fn(extents, move |i| motley(11 * i + k) + 0.2))
    };
    check(
        Check::of_cases("irradiance", cases)
            .large(1, Just(of(rows([9, 3], 1), rows([9000, 3], 2))))
            .refuses("four coefficients", of(leaf([4, 3], 1.0), leaf([2, 3], 1.0)))
            .refuses("a normal of no length", of(leaf([9, 3], 1.0), leaf([2, 3], 0.0))),
    );
}

#[derive(Debug)]
struct InEnvironment {
    prefilter: Prefilter<f64>,
    model: Model,
}

impl Subject for InEnvironment {
    /// Texels, normals, views and a material.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let prefilter = self.prefilter.cast();
        let environment = Environment::of_texels(inputs[0], &prefilter)?;
        let surface = Surface { normals: inputs[1], views: inputs[2], positions: None };
        let material = self.model.material(&inputs[3..]);
        let out = environment.shade(&surface, &material)?;
        // The texels beside which each mirrored direction lies, on each level.
        let (n, v) = (wide(inputs[1]), wide(inputs[2]));
        let cell = |(n, v): (&[f64], &[f64])| {
            let (n, v) = (DVec3::from_slice(n).normalize(), DVec3::from_slice(v));
            let r = (2.0 * n.dot(v) * n - v).to_array();
            let largest = r.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let axis = r.iter().position(|x| x.abs() == largest);
            let at = |level: usize| {
                r.map(|x| (f64::from(8 >> level) * (0.5 * x / largest + 0.5) - 0.5).floor() as i64)
            };
            (axis, [0, 1, 2].map(at), n.dot(v) > 0.0)
        };
        let cells: Vec<_> = n.data().chunks(3).zip(v.data().chunks(3)).map(cell).collect();
        let level = |roughness: &f64| *roughness > 0.5;
        let levels: Vec<_> = inputs
            .get(4)
            .map(|r| wide(*r).data().iter().map(level).collect::<Vec<_>>())
            .into_iter()
            .collect();
        let images = environment.reflections.levels()[1..].to_vec();
        Ok(Outcome::from([vec![out], images].concat()).with_state((cells, levels)))
    }
}

#[test]
fn shading_in_an_environment() {
    for (name, model) in [MODELS[0], MODELS[1], MODELS[2]] {
        let cases = (tensor([6, 8, 8, 3], number()), facing(ROWS), model.inputs(Some(ROWS)));
        let cases = cases.prop_map(move |(texels, both, material)| {
            let prefilter = Prefilter::new(8, 3).unwrap();
            let inputs = leaves([texels].into_iter().chain(both).chain(material));
            Case::new(InEnvironment { prefilter, model }, inputs)
        });
        check(Check::of_cases(format!("environment, {name}"), cases));
    }
}

#[derive(Debug)]
struct Reflect;

impl Subject for Reflect {
    /// Directions and normals.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(reflect(inputs[0], inputs[1])?.into())
    }
}

#[test]
fn reflect_of_directions_and_normals() {
    let of = |d: Input, n: Input| Case::new(Reflect, [d, n]);
    let cases = (tensor([ROWS, 3], number()), vectors(ROWS))
        .prop_map(move |(d, n)| of(Input::leaf(d), Input::leaf(n)));
    let rows =
        |k: usize| Input::leaf(Tensor::from_flat_fn([9000, 3], move |i| motley(11 * i + k) + 0.2));
    check(
        Check::of_cases("reflect", cases)
            .large(1, Just(of(rows(1), rows(2))))
            .refuses("directions of two", of(leaf([2, 2], 1.0), leaf([2, 2], 1.0)))
            .refuses("other rows", of(leaf([2, 3], 1.0), leaf([3, 3], 1.0))),
    );
}

/// A tone curve.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Tone {
    Encode,
    Decode,
    Exposure,
}

impl Subject for Tone {
    /// Light, and stops.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let (out, seam) = match self {
            Self::Encode => (srgb_encode(inputs[0])?, 0.0031308),
            Self::Decode => (srgb_decode(inputs[0])?, 0.04045),
            Self::Exposure => (exposure(inputs[0], inputs[1])?, 0.0),
        };
        let side = |x: &f64| *self != Self::Exposure && x.abs() > seam;
        let sides: Vec<_> = wide(inputs[0]).data().iter().map(side).collect();
        Ok(Outcome::from(out).with_state(sides))
    }
}

#[test]
fn tone_curves() {
    for tone in [Tone::Encode, Tone::Decode] {
        let numbers = prop_oneof![4 => -0.2..1.5_f64, 1 => -0.004..0.004_f64, 1 => 0.03..0.05_f64];
        let cases = vec(numbers, 6).prop_map(move |entries| {
            Case::new(tone, [Input::leaf(Tensor::new([2, 3], entries).unwrap())])
        });
        let many = Tensor::from_flat_fn([90_000], |k| motley(k) + 0.2);
        let check_of = Check::of_cases(format!("{tone:?}"), cases);
        check(check_of.large(1, Just(Case::new(tone, [Input::leaf(many)]))));
    }
    let stops = select(&[true, false][..])
        .prop_flat_map(|one| vec(-2.0..2.0_f64, if one { 1 } else { 3 }))
        .prop_map(|entries| match entries.len() {
            1 => Tensor::scalar(entries[0]),
            _ => Tensor::new([3], entries).unwrap(),
        });
    let cases = (tensor([2, 3], number()), stops)
        .prop_map(|(x, stops)| Case::new(Tone::Exposure, [x, stops].map(Input::leaf)));
    let wrong = Case::new(Tone::Exposure, [leaf([2, 3], 1.0), leaf([2], 1.0)]);
    check(Check::of_cases("exposure", cases).refuses_midway("stops of two", wrong));
}
