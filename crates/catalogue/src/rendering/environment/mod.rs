//! Materials in an environment of texels.

mod extremes;

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Var};
use bokashi_render_ops::{Environment, Prefilter, Surface};
use glam::DVec3;
use proptest::prelude::*;

use crate::entry::Entry;
use crate::inputs::{leaves, wide};
use crate::materials::{MODELS, Model, ROWS, facing};

/// Texels along a side of the sharpest level.
const EXTENT: usize = 4;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("environment").with_extremes(extremes::EXTREMES);
    let prefilter = Prefilter::new(EXTENT, 3).unwrap();
    for (name, model) in [MODELS[0], MODELS[1], MODELS[2]] {
        let cases =
            (tensor([6, EXTENT, EXTENT, 3], number()), facing(ROWS), model.inputs(Some(ROWS)));
        let prefilter = prefilter.clone();
        let cases = cases.prop_map(move |(texels, both, material)| {
            let inputs = leaves([texels].into_iter().chain(both).chain(material));
            Case::new(InEnvironment { prefilter: prefilter.clone(), model }, inputs)
        });
        entry.check(Check::from_cases(format!("environment, {name}"), cases));
    }
    entry
}

#[derive(Debug)]
struct InEnvironment {
    prefilter: Prefilter<f64>,
    model: Model,
}

impl Subject for InEnvironment {
    /// Texels, normals, views and a material.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let prefilter = self.prefilter.cast();
        let environment = Environment::from_texels(inputs[0], &prefilter)?;
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
                r.map(|x| {
                    ((EXTENT >> level) as f64 * (0.5 * x / largest + 0.5) - 0.5).floor() as i64
                })
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
