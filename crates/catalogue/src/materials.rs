//! Models of reflection, and the directions that light them.

use std::f64::consts::{FRAC_PI_2, PI};

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::Material;
use glam::DVec3;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::measures::{number, vector};

/// A model of reflection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Model {
    MetallicRoughness { conserves_energy: bool },
    Lambert,
    Phong,
    BlinnPhong,
}

impl Model {
    /// The numbers of each part of its material.
    pub(crate) fn widths(self) -> &'static [usize] {
        match self {
            Self::MetallicRoughness { .. } => &[3, 1, 1],
            Self::Lambert => &[3],
            Self::Phong | Self::BlinnPhong => &[3, 3, 1],
        }
    }

    pub(crate) fn material<'t, T: Scalar>(self, parts: &[Var<'t, T>]) -> Material<'t, T> {
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
    pub(crate) fn inputs(self, rows: Option<usize>) -> BoxedStrategy<Vec<Tensor<f64>>> {
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

pub(crate) const MODELS: [(&str, Model); 5] = [
    ("metallic-roughness", Model::MetallicRoughness { conserves_energy: false }),
    (
        "metallic-roughness that conserves energy",
        Model::MetallicRoughness { conserves_energy: true },
    ),
    ("Lambert", Model::Lambert),
    ("Phong", Model::Phong),
    ("Blinn-Phong", Model::BlinnPhong),
];

pub(crate) const ROWS: usize = 4;

/// Vectors that are neither short nor long.
pub(crate) fn directions(count: usize) -> BoxedStrategy<Tensor<f64>> {
    let vector = vec(-1.0..1.0_f64, 3)
        .prop_filter("a length", |d| d.iter().map(|x| x * x).sum::<f64>() > 0.1);
    let entries = vec(vector, count);
    entries.prop_map(move |all| Tensor::from_flat_fn([count, 3], |k| all[k / 3][k % 3])).boxed()
}

/// Normals and views: mostly an eye before the surface, sometimes behind it.
pub(crate) fn facing(count: usize) -> BoxedStrategy<[Tensor<f64>; 2]> {
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
    let both = [directions(count), directions(count)].prop_filter("at a right angle", are_clear);
    (both, select(&[false, false, false, true][..]))
        .prop_map(move |(both, behind)| before(both, behind))
        .boxed()
}

pub(crate) fn flat(tensor: Tensor<f64>) -> Tensor<f64> {
    Tensor::new([3], tensor.data().to_vec()).unwrap()
}

pub(crate) fn strengths() -> impl Strategy<Value = Tensor<f64>> {
    vec(0.1..2.0_f64, 3).prop_map(|entries| Tensor::new([3], entries).unwrap())
}

/// Angles from the normal: along it, grazing, just behind, and from behind.
pub(crate) const ANGLES: [f64; 9] =
    [0.0, 1e-7, 1e-4, 0.7, 1.57, FRAC_PI_2 - 3e-8, FRAC_PI_2 + 4e-6, 2.0, PI - 5e-8];

pub(crate) fn towards(angle: f64, turn: f64) -> [f64; 3] {
    [angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos()]
}

/// The numbers of a material: roughness, metallic, and the exponent of highlights.
pub(crate) type Numbers = [f64; 3];

/// All materials, with gradients to all of their numbers.
pub(crate) fn all_materials<T: Scalar>(
    tape: &Tape<T>,
    [roughness, metallic, exponent]: Numbers,
) -> ([Material<'_, T>; 5], [Var<'_, T>; 4]) {
    let color = vector(tape, [0.9, 0.5, 0.1]);
    let [roughness, metallic, exponent] =
        [roughness, metallic, exponent].map(|entry| number(tape, entry));
    let metal = |conserves_energy| Material::MetallicRoughness {
        base_color: color,
        roughness,
        metallic,
        conserves_energy,
    };
    let specular = color;
    let all = [
        metal(false),
        metal(true),
        Material::Lambert { color },
        Material::Phong { color, specular, exponent },
        Material::BlinnPhong { color, specular, exponent },
    ];
    (all, [color, roughness, metallic, exponent])
}
