//! A row of the table: what is learnt of each subject, from its start to its end in the scene.

use std::collections::HashSet;

use bokashi_core::Tensor;
use bokashi_fit::{FitError, Mapping, Parameter};

use super::frame::Frame;
use crate::description::{
    Learn, LearnExposure, LearnField, LearnLens, LearnMaps, LearnNumbers, LearnObjects, LearnPose,
    LearnVertices, Positive,
};
use crate::error::{Location, SceneError};
use crate::object::Object;
use crate::scene::Scene;

/// The usual rate of vertices with smoothing: large steps are divided by one number for all vertices.
const SMOOTH_RATE: f64 = 0.03;

/// What can be learnt of a scene: a number, or an array, for each of its subjects.
pub(crate) struct Learnable {
    /// Its table in `[learn]`, by which stages name it.
    pub(crate) key: &'static str,
    /// What its parameter is called; with several subjects, what comes before their names.
    pub(super) name: &'static str,
    /// What `[learn]` says of it.
    pub(crate) entry: fn(&Learn) -> Option<Entry<'_>>,
    pub(super) subjects: Subjects,
    /// Whether its value has a row for each view.
    pub(crate) has_rows_of_views: bool,
    /// What of a view it changes besides colours.
    pub(crate) moves: Moves,
    /// From raw numbers to values. A start lies at least `margin` inside its range.
    pub(super) mapping: Mapping,
    pub(super) margin: f32,
    /// The usual learning rate of raw numbers.
    pub(super) rate: f64,
    /// The unit of rates in words, and its size.
    pub(super) unit: &'static str,
    pub(super) unit_size: fn(&Scene, usize) -> f64,
    /// Why it can't be learnt of a subject with this index and this name.
    pub(super) refusal: fn(&Scene, usize, &str) -> Option<String>,
    /// The value that a subject has; `None` of one that has none, which is passed over.
    pub(super) start: fn(&Scene, usize) -> Option<Tensor<f32>>,
    /// Puts a value into a subject of a scene that had these measures.
    pub(super) apply: fn(&mut Scene, usize, &Tensor<f32>, &Frame) -> Result<(), FitError>,
}

/// What the numbers of a row belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Subjects {
    /// The whole scene.
    Scene,
    Meshes,
    /// Those of each mesh after those of the mesh before.
    Materials,
    Lights,
    /// The whole scene, and then each view.
    Views,
}

/// What of a view a learnable changes besides colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Moves {
    Nothing,
    /// Edges between colours, which exact silhouettes see.
    Creases,
    /// Where vertices are seen.
    Vertices,
}

/// What `[learn]` says of a row.
#[derive(Default)]
pub(crate) struct Entry<'l> {
    pub(crate) rate: Option<f64>,
    /// In place of that of the row.
    usual_rate: Option<f64>,
    /// Names of meshes or materials; `None` for all.
    pub(crate) meshes: Option<&'l [String]>,
    pub(crate) total_variation: Option<Positive>,
}

impl Learnable {
    /// A row of numbers that are learnt as they are; what a row says besides stands in its place.
    pub(super) const fn new(key: &'static str, subjects: Subjects, rate: f64) -> Self {
        Self {
            key,
            name: key,
            entry: |_| None,
            subjects,
            has_rows_of_views: false,
            moves: Moves::Nothing,
            mapping: Mapping::Identity,
            margin: 1e-3,
            rate,
            unit: "1",
            unit_size: |_, _| 1.0,
            refusal: |_, _, _| None,
            start: |_, _| None,
            apply: |_, _, _, _| Ok(()),
        }
    }

    /// The name of the parameter of a subject; that of the whole scene is empty.
    pub(crate) fn parameter_name(&self, subject: &str) -> String {
        match subject {
            "" => self.name.to_owned(),
            _ => format!("{}/{subject}", self.name),
        }
    }

    /// The names of all subjects, by index.
    fn subject_names(&self, scene: &Scene) -> Vec<String> {
        match self.subjects {
            Subjects::Scene => vec![String::new()],
            Subjects::Meshes => scene.objects.iter().map(|object| object.name.clone()).collect(),
            Subjects::Materials => {
                let names = |object: &Object| -> Vec<_> {
                    object.materials.iter().map(|material| object.material_name(material)).collect()
                };
                scene.objects.iter().flat_map(names).collect()
            }
            Subjects::Lights => {
                (0..scene.description.lights.len()).map(|index| index.to_string()).collect()
            }
            Subjects::Views => {
                let names = scene.views.iter().map(|view| view.name.clone());
                std::iter::once(String::new()).chain(names).collect()
            }
        }
    }

    /// The name of the parameter that has what a view has of its own; `None` of what views share.
    pub(crate) fn own_name(&self, scene: &Scene, view: usize) -> Option<String> {
        match self.subjects {
            Subjects::Views => Some(self.parameter_name(&scene.views[view].name)),
            _ => self.has_rows_of_views.then(|| self.parameter_name("")),
        }
    }

    /// The names of its parameters, if all that can be is learnt.
    pub(crate) fn parameter_names(&self, scene: &Scene) -> Vec<String> {
        self.subject_names(scene).iter().map(|name| self.parameter_name(name)).collect()
    }

    /// The rate where an entry gives none, and the unit of both in words.
    pub(super) fn usual_rate(&self, entry: &Entry<'_>) -> (f64, &'static str) {
        (entry.usual_rate.unwrap_or(self.rate), self.unit)
    }

    /// The parameters that an entry asks for, with their rates.
    ///
    /// # Errors
    /// [`SceneError::Content`] for a subject that is not there, or whose number can't be learnt.
    pub(crate) fn parameters(
        &self,
        scene: &Scene,
        entry: &Entry<'_>,
    ) -> Result<Vec<(Parameter<f32>, f64)>, SceneError> {
        let rate = entry.rate.unwrap_or(self.usual_rate(entry).0);
        let mut parameters = Vec::new();
        for (index, name) in self.chosen(scene, entry.meshes)? {
            if let Some(message) = (self.refusal)(scene, index, &name) {
                return Err(SceneError::content(Location::new(&scene.path), message));
            }
            let Some(start) = (self.start)(scene, index) else { continue };
            let margin = self.margin;
            let start = match self.mapping {
                Mapping::Sigmoid => start.map(|x| x.clamp(margin, 1.0 - margin)),
                Mapping::Softplus | Mapping::Exp => start.map(|x| x.max(margin)),
                _ => start,
            };
            let parameter = Parameter::new(self.parameter_name(&name), start);
            let rate = rate * (self.unit_size)(scene, index);
            parameters.push((parameter.mapping(self.mapping), rate));
        }
        Ok(parameters)
    }

    /// The subjects that a table of `learn` names, each name once: those of a mesh, or single materials. All, where it
    /// names none. Materials of one name are learnt as one.
    ///
    /// # Errors
    /// [`SceneError::Content`] for a name that nothing has.
    pub(crate) fn chosen(
        &self,
        scene: &Scene,
        names: Option<&[String]>,
    ) -> Result<Vec<(usize, String)>, SceneError> {
        let all: Vec<_> = self.subject_names(scene).into_iter().enumerate().collect();
        let mut chosen = if names.is_none() { all.clone() } else { Vec::new() };
        for name in names.unwrap_or_default() {
            let is_named = |(_, subject): &&(usize, String)| {
                let rest = subject.strip_prefix(name);
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
            };
            let before = chosen.len();
            chosen.extend(all.iter().filter(is_named).cloned());
            if chosen.len() == before {
                let objects = scene.objects.iter().map(|object| object.name.as_str());
                let materials = all.iter().map(|(_, name)| name.as_str());
                let known: Vec<_> =
                    objects.chain(materials.filter(|name| name.contains('/'))).collect();
                let rule =
                    format!("`meshes` of `learn.{}` are among {}", self.key, known.join(", "));
                let message = format!("{rule}, and {name:?} is not");
                return Err(SceneError::content(Location::new(&scene.path), message));
            }
        }
        let mut seen = HashSet::new();
        chosen.retain(|(_, name)| seen.insert(name.clone()));
        Ok(chosen)
    }

    /// Puts what `value` gives for the name of a parameter into a scene that had these measures.
    ///
    /// # Errors
    /// Those of motions without a matrix: see [`Pivot::motion`](super::frame::Pivot::motion).
    pub(crate) fn put(
        &self,
        scene: &mut Scene,
        frame: &Frame,
        value: impl Fn(&str) -> Option<Tensor<f32>>,
    ) -> Result<(), FitError> {
        for (index, name) in self.parameter_names(scene).iter().enumerate() {
            if let Some(value) = value(name) {
                (self.apply)(scene, index, &value, frame)?;
            }
        }
        Ok(())
    }
}

fn number(rate: Option<Positive>) -> Option<f64> {
    rate.map(|rate| rate.0)
}

impl<'l> From<&'l LearnNumbers> for Entry<'l> {
    fn from(entry: &'l LearnNumbers) -> Self {
        Self { rate: number(entry.rate), ..Self::default() }
    }
}

impl<'l> From<&'l LearnExposure> for Entry<'l> {
    fn from(entry: &'l LearnExposure) -> Self {
        Self { rate: number(entry.rate), ..Self::default() }
    }
}

impl<'l> From<&'l LearnLens> for Entry<'l> {
    fn from(entry: &'l LearnLens) -> Self {
        Self { rate: number(entry.rate), ..Self::default() }
    }
}

impl<'l> From<&'l LearnObjects> for Entry<'l> {
    fn from(entry: &'l LearnObjects) -> Self {
        let meshes = entry.meshes.as_deref();
        Self { rate: number(entry.rate), meshes, ..Self::default() }
    }
}

impl<'l> From<&'l LearnField> for Entry<'l> {
    fn from(entry: &'l LearnField) -> Self {
        let meshes = entry.meshes.as_deref();
        Self { rate: number(entry.rate), meshes, ..Self::default() }
    }
}

impl<'l> From<&'l LearnPose> for Entry<'l> {
    fn from(entry: &'l LearnPose) -> Self {
        let meshes = entry.meshes.as_deref();
        Self { rate: number(entry.rate), meshes, ..Self::default() }
    }
}

impl<'l> From<&'l LearnMaps> for Entry<'l> {
    fn from(entry: &'l LearnMaps) -> Self {
        let (meshes, total_variation) = (entry.meshes.as_deref(), entry.total_variation);
        Self { rate: number(entry.rate), meshes, total_variation, ..Self::default() }
    }
}

impl<'l> From<&'l LearnVertices> for Entry<'l> {
    fn from(entry: &'l LearnVertices) -> Self {
        let (meshes, usual_rate) = (entry.meshes.as_deref(), entry.smoothing.map(|_| SMOOTH_RATE));
        Self { rate: number(entry.rate), usual_rate, meshes, ..Self::default() }
    }
}
