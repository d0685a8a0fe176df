//! What is learnt: the parameters of a scene, with rates, mappings and regularizers.

use std::sync::Arc;

use bokashi_core::{SparseMatrix, Tape, Tensor, Var};
use bokashi_fit::{
    FitError, Mapping, Parameter, Parameters, Penalty, Preconditioner, RigidWeights, Rigidity,
    Topology, Variables, edge_length_error, laplacian_error, normal_error, total_variation,
};

use crate::cameras::Distortion;
use crate::description::{LearnMaps, LightPlace, Positive};
use crate::error::{Place, SceneError};
use crate::memory::OF_LEARNT_NUMBER;
use crate::object::{Object, SurfaceLook};
use crate::renderer::Renderer;
use crate::scene::Scene;
use crate::values::of_object;

/// Values under [`Mapping::Sigmoid`] start at least so far inside.
const MARGIN: f32 = 1e-3;

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
    /// The rate of each parameter, before stages.
    pub(crate) rates: Vec<(String, f64)>,
    pub(crate) regularizers: Vec<Regularizer>,
    pub(crate) preconditioners: Vec<(String, Preconditioner)>,
}

impl Learnt {
    /// What `scene.toml` asks for.
    ///
    /// # Errors
    /// [`SceneError::Content`] for a mesh that is not there, or lacks what is to be learnt, and where
    /// nothing is learnt; [`SceneError::Fit`] for what the fit refuses.
    pub(crate) fn of(renderer: &Renderer) -> Result<Self, SceneError> {
        let scene = renderer.scene();
        let mut all = Self {
            parameters: Parameters::new(),
            rates: Vec::new(),
            regularizers: Vec::new(),
            preconditioners: Vec::new(),
        };
        all.add_vertices(scene)?;
        all.add_looks(scene)?;
        all.add_numbers(scene)?;
        if all.parameters.iter().len() == 0 {
            return Err(wrong(scene, "a fit learns something: `learn` names nothing"));
        }
        let numbers: usize = all.parameters.iter().map(|own| own.raw().size()).sum();
        let bytes = (numbers as u64).saturating_mul(OF_LEARNT_NUMBER);
        let what = || format!("a fit of {numbers} numbers");
        scene.folder.memory().check(bytes, &Place::of(&scene.path), what)?;
        Ok(all)
    }

    fn add(&mut self, parameter: Parameter<f32>, rate: f64) -> Result<(), SceneError> {
        self.rates.push((parameter.name().to_owned(), rate));
        let list = std::mem::take(&mut self.parameters);
        // What no view of the first step sees can be seen later.
        self.parameters = list.with(parameter.rate(rate).optional())?;
        Ok(())
    }

    fn add_vertices(&mut self, scene: &Scene) -> Result<(), SceneError> {
        let Some(own) = &scene.description.learn.vertices else { return Ok(()) };
        for object in chosen(scene, own.meshes.as_deref(), "vertices")? {
            let name = of_object("vertices", &object.name);
            let radius = own_radius(object);
            let topology = Topology::new(object.mesh.faces(), object.mesh.vertex_count())
                .map_err(FitError::from)?;
            let mut parameter = Parameter::new(&name, object.positions.clone());
            // Large steps are divided by one number for all vertices.
            let usual = if own.smoothing.is_some() { 0.03 } else { 0.003 };
            let rate = rate(own.rate, usual) * radius;
            if let Some(lambda) = own.smoothing {
                let smooth = Preconditioner::new(&topology, lambda.0).map_err(FitError::from)?;
                parameter = parameter.preconditioned(&smooth);
                self.preconditioners.push((name.clone(), smooth));
            }
            let radius = radius as f32;
            let rigidity = || {
                let rest = object.positions.map(|x| x * (1.0 / radius));
                Rigidity::new(&topology, &rest, RigidWeights::Cotangent).map_err(FitError::from)
            };
            let rigid = own.rigid.map(|weight| Ok::<_, FitError>((weight, rigidity()?)));
            let rules = [
                rigid.transpose()?.map(|(weight, rest)| (weight, Rule::Rigid(rest, radius))),
                own.laplacian.map(|weight| {
                    let matrix = Arc::new(topology.uniform_laplacian());
                    (weight, Rule::Laplacian(matrix, radius))
                }),
                own.edge_length.map(|weight| (weight, Rule::EdgeLength(topology.clone(), radius))),
                own.normals.map(|weight| (weight, Rule::Normals(topology.clone()))),
            ];
            for (weight, rule) in rules.into_iter().flatten() {
                self.regularize(&name, weight, rule);
            }
            self.add(parameter, rate)?;
        }
        Ok(())
    }

    fn regularize(&mut self, name: &str, weight: Positive, rule: Rule) {
        let (parameter, weight) = (name.to_owned(), weight.0 as f32);
        self.regularizers.push(Regularizer { parameter, weight, rule });
    }

    /// Colours, textures, and numbers of materials.
    fn add_looks(&mut self, scene: &Scene) -> Result<(), SceneError> {
        let learn = &scene.description.learn;
        if let Some(own) = &learn.colors {
            for object in chosen(scene, own.meshes.as_deref(), "colors")? {
                let Some(colors) = &object.colors else {
                    let rule = "a mesh whose `colors` are learnt has colours at vertices";
                    return Err(wrong(scene, format!("{rule}, and {:?} has none", object.name)));
                };
                let name = of_object("colors", &object.name);
                self.add_share(name, &colors.rows, own.rate)?;
            }
        }
        type Start = fn(&SurfaceLook) -> Tensor<f32>;
        let kinds: [(&str, &Option<LearnMaps>, Start); 3] = [
            ("texture", &learn.texture, |look| {
                look.texture.clone().unwrap_or(Tensor::from(look.base_color))
            }),
            ("roughness", &learn.roughness, |look| numbers(look, 0)),
            ("metallic", &learn.metallic, |look| numbers(look, 1)),
        ];
        for (kind, own, start) in kinds {
            let Some(own) = own else { continue };
            let mut maps = 0;
            for (object, look) in chosen_looks(scene, own.meshes.as_deref(), kind)? {
                let name = object.parameter(kind, look);
                // Looks of one material are learnt as one.
                if self.rates.iter().any(|(own, _)| *own == name) {
                    continue;
                }
                let lacks = match kind {
                    "texture" => look.lacks_texture,
                    _ => look.lacks_roughness_metallic,
                };
                if lacks {
                    let rule = format!("an image that `learn.{kind}` learns is there");
                    let found = "its file names one that is missing or can't be read";
                    let name = object.look_name(look);
                    return Err(wrong(scene, format!("{rule}, and of {name:?} {found}")));
                }
                let start = start(look);
                if start.shape().len() == 3 {
                    maps += 1;
                    if let Some(weight) = own.total_variation {
                        self.regularize(&name, weight, Rule::TotalVariation);
                    }
                }
                self.add_share(name, &start, own.rate)?;
            }
            if let (0, Some(weight)) = (maps, own.total_variation) {
                let rule = format!("`learn.{kind}` has a total variation where a mesh has a map");
                return Err(wrong(scene, format!("{rule}: none has, and it is {}", weight.0)));
            }
        }
        Ok(())
    }

    /// Numbers from 0 to 1.
    fn add_share(
        &mut self,
        name: String,
        start: &Tensor<f32>,
        own: Option<Positive>,
    ) -> Result<(), SceneError> {
        let start = start.map(|x| x.clamp(MARGIN, 1.0 - MARGIN));
        let parameter = Parameter::new(name, start).mapping(Mapping::Sigmoid);
        self.add(parameter, rate(own, 0.05))
    }

    /// Poses, cameras, lights, and numbers of the whole picture.
    fn add_numbers(&mut self, scene: &Scene) -> Result<(), SceneError> {
        let learn = &scene.description.learn;
        let pipeline = &scene.description.pipeline;
        if let Some(own) = &learn.pose {
            for object in chosen(scene, own.meshes.as_deref(), "pose")? {
                let name = of_object("pose", &object.name);
                self.add(Parameter::new(name, Tensor::zeros([6])), rate(own.rate, 0.01))?;
            }
        }
        if let Some(own) = &learn.cameras {
            let start = Tensor::zeros([scene.views.len(), 6]);
            self.add(Parameter::new("cameras", start), rate(own.rate, 3e-3))?;
        }
        if let Some(own) = &learn.intrinsics {
            self.add(Parameter::new("intrinsics", Tensor::zeros([4])), rate(own.rate, 2e-3))?;
        }
        if let Some(own) = &learn.distortion {
            let mut lenses = scene.views.iter().map(|view| view.camera.distortion);
            let first = lenses.next().unwrap_or(Distortion::NONE);
            if !lenses.all(|lens| lens.is_kind_of(&first)) {
                let rule = "a `distortion` that is learnt is of one kind of lens";
                let kinds = scene.views.iter().map(|view| view.camera.distortion.kind());
                let kinds: std::collections::BTreeSet<_> = kinds.collect();
                let found = kinds.into_iter().collect::<Vec<_>>().join(" and ");
                return Err(wrong(scene, format!("{rule}, and those of the views are {found}")));
            }
            let first = first.coefficients();
            let start = Tensor::from_flat_fn([first.len()], |k| first[k] as f32);
            self.add(Parameter::new("distortion", start), rate(own.rate, 2e-3))?;
        }
        if let Some(own) = &learn.lights {
            for (at, light) in scene.description.lights.iter().enumerate() {
                let name = of_object("light", &at.to_string());
                let start = light.color().map(|x| (x as f32).max(MARGIN));
                let parameter = Parameter::new(name, Tensor::from(start));
                self.add(parameter.mapping(Mapping::Softplus), rate(own.rate, 0.03))?;
            }
        }
        if let Some(own) = &learn.light_places {
            for (at, light) in scene.description.lights.iter().enumerate() {
                let Some((place, unit)) = light.place().map(|own| match own {
                    LightPlace::Direction(own) => (own.normalize(), 1.0),
                    LightPlace::Position(own) => (own, scene.ball().1),
                }) else {
                    continue;
                };
                let name = of_object("light_place", &at.to_string());
                let start = Tensor::from(place.as_vec3().to_array());
                self.add(Parameter::new(name, start), rate(own.rate, 0.02) * unit)?;
            }
        }
        if let Some(own) = &learn.environment {
            let Some(texels) = &scene.environment else {
                return Err(wrong(scene, "an environment that is learnt is in the scene"));
            };
            let start = texels.map(|x| x.max(MARGIN));
            let parameter = Parameter::new("environment", start).mapping(Mapping::Softplus);
            self.add(parameter, rate(own.rate, 0.03))?;
        }
        if let Some(own) = &learn.exposure {
            let stops = pipeline.exposure.map_or(0.0, |stops| stops.0);
            let parameter = Parameter::new("exposure", Tensor::scalar(stops as f32));
            self.add(parameter, rate(own.rate, 0.02))?;
        }
        if let Some(own) = &learn.blur {
            let Some(sigma) = pipeline.blur else {
                return Err(wrong(scene, "a blur that is learnt is in the pipeline"));
            };
            let parameter = Parameter::new("blur", Tensor::scalar(sigma.0 as f32));
            self.add(parameter.mapping(Mapping::Softplus), rate(own.rate, 0.05))?;
        }
        if let Some(own) = &learn.lens {
            let Some(lens) = pipeline.lens else {
                return Err(wrong(scene, "a lens that is learnt is in the pipeline"));
            };
            let numbers = [("aperture", lens.aperture.0), ("focus", lens.focus.0)];
            for (name, start) in numbers {
                let start = Tensor::scalar((start as f32).max(MARGIN));
                let parameter = Parameter::new(name, start).mapping(Mapping::Exp);
                self.add(parameter, rate(own.rate, 0.02))?;
            }
        }
        Ok(())
    }
}

fn rate(own: Option<Positive>, usual: f64) -> f64 {
    own.map_or(usual, |rate| rate.0)
}

fn wrong(scene: &Scene, message: impl std::fmt::Display) -> SceneError {
    SceneError::content(Place::of(&scene.path), message)
}

/// The objects that a part of `learn` is about.
fn chosen<'s>(
    scene: &'s Scene,
    names: Option<&[String]>,
    key: &str,
) -> Result<Vec<&'s Object>, SceneError> {
    let Some(names) = names else { return Ok(scene.objects.iter().collect()) };
    let find = |name: &String| {
        scene.objects.iter().find(|object| object.name == *name).ok_or_else(|| {
            let all: Vec<_> = scene.objects.iter().map(|object| object.name.as_str()).collect();
            let rule = format!("`meshes` of `learn.{key}` are among {}", all.join(", "));
            wrong(scene, format!("{rule}, and {name:?} is not"))
        })
    };
    names.iter().map(find).collect()
}

/// The looks that a part of `learn` is about: those of the objects that it names, or single ones.
fn chosen_looks<'s>(
    scene: &'s Scene,
    names: Option<&[String]>,
    key: &str,
) -> Result<Vec<(&'s Object, &'s SurfaceLook)>, SceneError> {
    let objects = scene.objects.iter();
    let all = objects.flat_map(|object| object.looks.iter().map(move |look| (object, look)));
    let all: Vec<_> = all.collect();
    let Some(names) = names else { return Ok(all) };
    let mut found = Vec::new();
    for name in names {
        let is_named = |(object, look): &&(&Object, &SurfaceLook)| {
            object.name == *name || object.look_name(look) == *name
        };
        let before = found.len();
        found.extend(all.iter().filter(is_named));
        if found.len() == before {
            let mut known: Vec<_> = scene.objects.iter().map(|own| own.name.clone()).collect();
            let several = all.iter().filter(|(object, _)| object.looks.len() > 1);
            known.extend(several.map(|(object, look)| object.look_name(look)));
            let rule = format!("`meshes` of `learn.{key}` are among {}", known.join(", "));
            return Err(wrong(scene, format!("{rule}, and {name:?} is not")));
        }
    }
    Ok(found)
}

/// The radius of an object in its own coordinates.
fn own_radius(object: &Object) -> f64 {
    let points = object.positions.data().chunks_exact(3);
    let points = points.map(|p| glam::DVec3::new(p[0].into(), p[1].into(), p[2].into()));
    let extent = points.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
    match extent.map(|[a, b]| 0.5 * a.distance(b)) {
        Some(radius) if radius > 0.0 => radius,
        _ => 1.0,
    }
}

/// Roughness or metallic of a look: its map, or its number.
fn numbers(look: &SurfaceLook, channel: usize) -> Tensor<f32> {
    let map = look.roughness_metallic_map(channel);
    map.unwrap_or_else(|| Tensor::scalar([look.roughness, look.metallic][channel]))
}

/// Whether pictures become images before they are compared, judged without a tape of a step.
pub(crate) fn is_dense(renderer: &Renderer) -> bool {
    let tape = Tape::new();
    let scene = renderer.scene();
    renderer.is_dense(&crate::values::Values { tape: &tape, learnt: None })
        || scene.description.loss.ssim.is_some_and(|share| share.0 > 0.0)
}
