//! All lights on all materials.

mod extremes;

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Light, Material, Surface, shade};
use glam::DVec3;
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, leaves, wide, with_one};
use crate::materials::{MODELS, Model, ROWS, directions, facing, flat, strengths};
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("shade").with_extremes(extremes::EXTREMES);
    for (name, model) in MODELS {
        let rows = select(&[Some(ROWS), None][..]);
        let cases = rows.prop_flat_map(move |rows| {
            let lights = (directions(1), strengths(), directions(1), strengths(), strengths());
            let all = (facing(ROWS), directions(ROWS), lights, model.inputs(rows));
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
        let colors = match model {
            Model::MetallicRoughness { .. } => "base colours",
            _ => "colours",
        };
        entry.check(
            Check::from_cases(format!("shade, {name}"), cases)
                .large(1, Just(many(model)))
                .refuses(
                    "shade needs normals of shape [N, 3], got shape [3]",
                    of(0, leaf([3], 1.0)),
                )
                .refuses(
                    "shade needs views of shape [2, 3] or [3], got shape [1, 3]",
                    of(1, leaf([1, 3], 1.0)),
                )
                .refuses_midway(
                    "shade needs positions of shape [2, 3], got shape [1, 3]",
                    of(2, leaf([1, 3], 1.0)),
                )
                .refuses_midway(
                    format!("shade needs {colors} of shape [2, 3] or [3], got shape [1, 3]"),
                    of(8, leaf([1, 3], 0.5)),
                )
                .refuses_midway(
                    "shade needs directions other than zero, got zero in row 1",
                    of(0, Input::leaf(Tensor::from([[1.0; 3], [0.0; 3]]))),
                )
                .refuses_midway(
                    "shade needs finite normals, got inf in row 0",
                    of(0, with_one([2, 3], 0, f64::INFINITY)),
                )
                .refuses_midway(
                    "shade needs finite views, got inf in row 0",
                    of(1, with_one([2, 3], 1, f64::INFINITY)),
                )
                .refuses_midway(
                    format!("shade needs finite {colors}, got NaN in row 0"),
                    of(8, leaf([3], f64::NAN)),
                )
                .refuses_midway(
                    "shade needs finite positions, got NaN in row 0",
                    of(2, leaf([2, 3], f64::NAN)),
                )
                .refuses(
                    "shade needs a light's direction other than zero, got 0",
                    of(3, leaf([3], 0.0)),
                )
                .refuses(
                    "shade needs an irradiance of 0 or more, got -0.5",
                    of(4, with_one([3], 1, -0.5)),
                )
                .refuses(
                    "shade needs an irradiance that is finite, got NaN",
                    of(4, with_one([3], 2, f64::NAN)),
                )
                .refuses_midway(
                    "shade needs a light's position that is finite, got NaN",
                    of(5, leaf([3], f64::NAN)),
                )
                .refuses_midway(
                    "shade needs finite inverse squares of distances to a point light, got inf in \
                     row 1",
                    of(5, Input::leaf(Tensor::from_flat_fn([3], |i| motley(i + 7)))),
                ),
        );
    }
    benchmarks(&mut entry);
    entry
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
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
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

/// What a light looks like on the surfaces of a setting.
macro_rules! lit {
    ($entry:ident, $label:literal, |$x:ident| ($material:expr, $light:expr)) => {
        benchmark!(
            $entry,
            $label,
            |s| [
                s.frames[0],
                s.frames[2],
                s.material[0],
                s.material[1],
                s.material[2],
                s.row,
                s.material[3],
            ],
            |$x| {
                let surface = Surface { normals: $x[0], views: $x[1], positions: Some($x[1]) };
                shade(&surface, &$material, &[$light])?
            }
        );
    };
}

fn benchmarks(entry: &mut Entry) {
    lit!(entry, "shade, metallic-roughness", |x| (metal(x, false), directional(x)));
    lit!(entry, "shade, energy conserved", |x| (metal(x, true), directional(x)));
    lit!(entry, "shade, a point light", |x| (
        metal(x, false),
        Light::Point { position: x[5] * T::from_f64(4.0), intensity: x[6] }
    ));
    lit!(entry, "shade, ambient", |x| (metal(x, true), Light::Ambient { radiance: x[6] }));
    lit!(entry, "shade, Lambert", |x| (Material::Lambert { color: x[2] }, directional(x)));
    lit!(entry, "shade, Blinn-Phong", |x| (
        Material::BlinnPhong { color: x[2], specular: x[6], exponent: x[3] * T::from_f64(20.0) },
        directional(x)
    ));
}

fn metal<'t, T: Scalar>(x: &[Var<'t, T>], conserves_energy: bool) -> Material<'t, T> {
    let (base_color, roughness, metallic) = (x[2], x[3], x[4]);
    Material::MetallicRoughness { base_color, roughness, metallic, conserves_energy }
}

fn directional<'t, T: Scalar>(x: &[Var<'t, T>]) -> Light<'t, T> {
    Light::Directional { direction: x[5], irradiance: x[6] }
}
