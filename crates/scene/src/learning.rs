//! What a fit of a scene learns: parameters with rates, from the table of `learnables/`, and regularizers.

use std::sync::Arc;

use bokashi_core::{SparseMatrix, Var};
use bokashi_fit::{
    FitError, Parameters, Penalty, Preconditioner, RigidWeights, Rigidity, Topology, Variables,
    edge_length_error, laplacian_error, normal_error, total_variation,
};

use crate::description::Positive;
use crate::error::{Location, SceneError};
use crate::learnables::{Learnable, TABLE, TEXTURE, VERTICES};
use crate::memory::OF_LEARNT_NUMBER;
use crate::scene::Scene;

/// What is added to the loss for one parameter.
pub(crate) struct Regularizer {
    parameter: String,
    weight: f32,
    rule: Rule,
}

enum Rule {
    /// Of positions as shares of this radius.
    Rigid(Rigidity, f32),
    Laplacian(Arc<SparseMatrix<f32>>, f32),
    EdgeLength(Topology, f32),
    Normals(Topology),
    TotalVariation,
}

impl Regularizer {
    /// Its part of the loss.
    pub(crate) fn loss<'t>(
        &self,
        variables: &Variables<'t, f32>,
    ) -> Result<Var<'t, f32>, FitError> {
        let value = variables.get(&self.parameter)?;
        let error = match &self.rule {
            Rule::Rigid(rest, radius) => rest.error(value * (1.0 / radius))?,
            Rule::Laplacian(matrix, radius) => laplacian_error(value * (1.0 / radius), matrix)?,
            Rule::EdgeLength(topology, radius) => {
                edge_length_error(value * (1.0 / radius), topology, 0.0)?
            }
            Rule::Normals(topology) => normal_error(value, topology)?,
            // Rounded where neighbours differ by less than a step of 8 bits.
            // Texels of gutters are as they are learnt, not copies: charts would be made alike where copies meet.
            Rule::TotalVariation => {
                total_variation(value, Penalty::Charbonnier { scale: 1.0 / 255.0 })?
            }
        };
        Ok(error * self.weight)
    }
}

/// All that a fit of a scene learns.
pub(crate) struct Learnt {
    pub(crate) parameters: Parameters<f32>,
    pub(crate) rates: Vec<LearntRate>,
    pub(crate) regularizers: Vec<Regularizer>,
    pub(crate) preconditioners: Vec<(String, Preconditioner)>,
}

/// The rate of a parameter, before stages.
pub(crate) struct LearntRate {
    /// The parameter's name.
    pub(crate) name: String,
    /// Its table in `[learn]`.
    pub(crate) key: &'static str,
    pub(crate) rate: f64,
}

impl Learnt {
    /// What `scene.toml` asks for.
    ///
    /// # Errors
    /// [`SceneError::Content`] for a mesh that is not there, or lacks what is to be learnt, and where
    /// nothing is learnt; [`SceneError::Fit`] for what the fit refuses.
    pub(crate) fn from_scene(scene: &Scene) -> Result<Self, SceneError> {
        let mut all = Self {
            parameters: Parameters::new(),
            rates: Vec::new(),
            regularizers: Vec::new(),
            preconditioners: Vec::new(),
        };
        all.regularize_vertices(scene)?;
        for row in TABLE {
            all.add_row(row, scene)?;
        }
        if all.parameters.iter().len() == 0 {
            return Err(wrong(scene, "a fit learns something: `learn` names nothing"));
        }
        let numbers: usize = all.parameters.iter().map(|parameter| parameter.raw().size()).sum();
        let bytes = (numbers as u64).saturating_mul(OF_LEARNT_NUMBER);
        let what = || format!("a fit of {numbers} numbers");
        scene.folder.memory().check(bytes, &Location::new(&scene.path), what)?;
        Ok(all)
    }

    /// Adds the parameters of a row of the table that the scene learns, and the total variation of maps.
    fn add_row(&mut self, row: &Learnable, scene: &Scene) -> Result<(), SceneError> {
        let Some(entry) = (row.entry)(&scene.description.learn) else { return Ok(()) };
        let mut maps = 0;
        for (mut parameter, rate) in row.parameters(scene, &entry)? {
            let name = parameter.name().to_owned();
            if parameter.raw().shape().len() == 3 {
                maps += 1;
                if let Some(weight) = entry.total_variation {
                    self.regularize(&name, weight, Rule::TotalVariation);
                }
            }
            if let Some((_, smooth)) =
                self.preconditioners.iter().find(|(learnt, _)| *learnt == name)
            {
                parameter = parameter.preconditioned(smooth);
            }
            let list = std::mem::take(&mut self.parameters);
            // What no view of the first step sees can be seen later.
            self.parameters = list.with(parameter.rate(rate).optional())?;
            self.rates.push(LearntRate { name, key: row.key, rate });
        }
        match entry.total_variation {
            Some(weight) if maps == 0 && !awaits_map(scene, row) => {
                let rule = "has a total variation where a mesh has a map: none has, and it is";
                Err(wrong(scene, format!("`learn.{}` {rule} {}", row.key, weight.0)))
            }
            _ => Ok(()),
        }
    }

    /// What keeps surfaces smooth whose vertices are learnt: preconditioners, and parts of the loss.
    fn regularize_vertices(&mut self, scene: &Scene) -> Result<(), SceneError> {
        let Some(entry) = &scene.description.learn.vertices else { return Ok(()) };
        for (index, name) in VERTICES.chosen(scene, entry.meshes.as_deref())? {
            let (name, object) = (VERTICES.parameter_name(&name), &scene.objects[index]);
            if object.field.is_some() {
                continue;
            }
            let topology = Topology::new(object.mesh.faces(), object.mesh.vertex_count())
                .map_err(FitError::from)?;
            if let Some(lambda) = entry.smoothing {
                let smooth = Preconditioner::new(&topology, lambda.0).map_err(FitError::from)?;
                self.preconditioners.push((name.clone(), smooth));
            }
            let radius = object.radius() as f32;
            let rigidity = || {
                let rest = object.positions.map(|x| x * (1.0 / radius));
                Rigidity::new(&topology, &rest, RigidWeights::Cotangent).map_err(FitError::from)
            };
            let rigid = entry.rigid.map(|weight| Ok::<_, FitError>((weight, rigidity()?)));
            let rules = [
                rigid.transpose()?.map(|(weight, rest)| (weight, Rule::Rigid(rest, radius))),
                entry.laplacian.map(|weight| {
                    let matrix = Arc::new(topology.uniform_laplacian());
                    (weight, Rule::Laplacian(matrix, radius))
                }),
                entry
                    .edge_length
                    .map(|weight| (weight, Rule::EdgeLength(topology.clone(), radius))),
                entry.normals.map(|weight| (weight, Rule::Normals(topology.clone()))),
            ];
            for (weight, rule) in rules.into_iter().flatten() {
                self.regularize(&name, weight, rule);
            }
        }
        Ok(())
    }

    fn regularize(&mut self, name: &str, weight: Positive, rule: Rule) {
        let (parameter, weight) = (name.to_owned(), weight.0 as f32);
        self.regularizers.push(Regularizer { parameter, weight, rule });
    }
}

/// Whether some mesh is still to get a map of a row.
fn awaits_map(scene: &Scene, row: &Learnable) -> bool {
    row.key == TEXTURE.key && scene.objects.iter().any(|object| scene.awaits_texture(object))
}

fn wrong(scene: &Scene, message: impl std::fmt::Display) -> SceneError {
    SceneError::content(Location::new(&scene.path), message)
}
