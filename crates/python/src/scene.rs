//! Scenes in files, and their fits.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bokashi_core::Tensor;
use bokashi_scene as scene;
use bokashi_scene::{Renderer, SceneError};
use numpy::PyArrayDyn;
use pyo3::exceptions::{PyIndexError, PyKeyError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use crate::array::{Array, to_array};
use crate::error::Refusal;
use crate::page::fit_page;
use crate::threads::released;

type Picture<'py> = PyResult<Bound<'py, PyArrayDyn<f32>>>;

/// A scene of a file `scene.toml`: meshes, cameras, images, and what is to be learnt.
#[pyclass(frozen, module = "bokashi")]
pub struct Scene(Arc<scene::Scene>);

/// A view by its number, or by its name.
#[derive(FromPyObject)]
enum View {
    Number(usize),
    Name(String),
}

impl View {
    fn number(self, scene: &scene::Scene) -> PyResult<usize> {
        match self {
            Self::Number(number) if number < scene.views.len() => Ok(number),
            Self::Number(number) => {
                let count = scene.views.len();
                Err(PyIndexError::new_err(format!(
                    "a view needs to be below {count}, got {number}"
                )))
            }
            Self::Name(name) => scene.view(&name).ok_or_else(|| PyKeyError::new_err(name)),
        }
    }
}

#[pymethods]
impl Scene {
    /// The scene of the file at `path`; all its files lie in that file's folder.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let scene = released(py, || scene::Scene::load(path)).map_err(Refusal::from)?;
        Ok(Self(Arc::new(scene)))
    }

    /// The names of the views.
    #[getter]
    fn views(&self) -> Vec<String> {
        self.0.views.iter().map(|view| view.name.clone()).collect()
    }

    /// What files hold that was left out or mended, in words.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes.clone()
    }

    /// The meshes by name: positions `[V, 3]` and faces `[F, 3]`.
    #[getter]
    fn meshes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        meshes(py, &self.0)
    }

    /// A view as it is seen, by number or name, smaller `reduce` times along each axis: `[H, W, 3]`, as pixels stand for it.
    #[pyo3(signature = (view=View::Number(0), reduce=1))]
    fn render<'py>(&self, py: Python<'py>, view: View, reduce: usize) -> Picture<'py> {
        let view = view.number(&self.0)?;
        let image = released(py, || Renderer::new(Arc::clone(&self.0))?.picture(view, reduce));
        to_array(py, image.map_err(Refusal::from)?)
    }

    /// A fit of the scene from its start, or the one that was saved to the file `resume`.
    #[pyo3(signature = (resume=None))]
    fn begin(&self, py: Python<'_>, resume: Option<PathBuf>) -> PyResult<SceneFit> {
        let scene = (*self.0).clone();
        let fit = released(py, || match resume {
            None => scene::SceneFit::new(scene),
            Some(path) => scene::SceneFit::resume(scene, path),
        });
        Ok(SceneFit(Mutex::new(fit.map_err(Refusal::from)?)))
    }

    fn __repr__(&self) -> String {
        let (objects, views) = (self.0.objects.len(), self.0.views.len());
        format!("Scene({:?}, {objects} objects, {views} views)", self.0.path)
    }
}

fn meshes<'py>(py: Python<'py>, scene: &scene::Scene) -> PyResult<Bound<'py, PyDict>> {
    let meshes = PyDict::new(py);
    for object in &scene.objects {
        let faces: Vec<u32> = object.mesh.faces().as_flattened().to_vec();
        let faces = numpy::PyArrayMethods::reshape(
            &numpy::PyArray1::from_vec(py, faces),
            [object.mesh.faces().len(), 3],
        )?;
        meshes.set_item(&object.name, (to_array(py, object.positions.clone())?, faces))?;
    }
    Ok(meshes)
}

/// A fit of a scene, under way.
#[pyclass(frozen, module = "bokashi")]
pub struct SceneFit(Mutex<scene::SceneFit>);

impl SceneFit {
    fn fit(&self) -> MutexGuard<'_, scene::SceneFit> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl SceneFit {
    /// Does a step. The loss before its update and the milliseconds it took come to the end of the lists: before any signal
    /// is seen. `False` where all steps are done, or a rule of the scene says stop: views that are held out are then
    /// aligned.
    fn step(
        &self,
        py: Python<'_>,
        losses: &Bound<'_, PyList>,
        milliseconds: &Bound<'_, PyList>,
    ) -> PyResult<bool> {
        let stepped = released(py, || {
            let mut fit = self.fit();
            let is_over = fit.ended().is_some() || fit.is_time_up();
            let stepped = if is_over { None } else { fit.step()? };
            if stepped.is_none() && fit.aligned_views().next().is_none() {
                fit.align()?;
            }
            Ok::<_, SceneError>(stepped)
        });
        let Some(stepped) = stepped.map_err(Refusal::from)? else { return Ok(false) };
        losses.append(stepped.loss)?;
        milliseconds.append(stepped.ms)?;
        Ok(true)
    }

    /// How many steps are done, of all stages.
    #[getter]
    fn steps_done(&self) -> u64 {
        self.fit().steps_done()
    }

    /// How many steps there are, of all stages.
    #[getter]
    fn steps(&self) -> u64 {
        self.fit().steps()
    }

    /// The rule that ended the fit, in words, if one did before the last step.
    #[getter]
    fn ended(&self) -> Option<String> {
        let fit = self.fit();
        fit.ended().or_else(|| fit.is_time_up().then(|| "its seconds are over".to_owned()))
    }

    /// What is learnt, by name.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let values: Vec<_> = {
            let fit = self.fit();
            fit.parameters()
                .iter()
                .map(|parameter| (parameter.name().to_owned(), parameter.value()))
                .collect()
        };
        let parameters = PyDict::new(py);
        for (name, value) in values {
            parameters.set_item(name, to_array(py, value)?)?;
        }
        Ok(parameters)
    }

    /// The scene with what was learnt in the place of its own numbers.
    fn learnt(&self) -> PyResult<Scene> {
        Ok(Scene(Arc::new(self.fit().learnt().map_err(Refusal::from)?)))
    }

    /// A view as it is seen, by number or name, smaller `reduce` times along each axis: `[H, W, 3]`.
    #[pyo3(signature = (view=View::Number(0), reduce=1))]
    fn render<'py>(&self, py: Python<'py>, view: View, reduce: usize) -> Picture<'py> {
        let view = view.number(self.fit().scene())?;
        let image = released(py, || self.fit().picture(view, reduce)).map_err(Refusal::from)?;
        to_array(py, image)
    }

    /// How well a view is matched: PSNR in decibels, SSIM, the intersection over union of silhouettes, and the PSNR before
    /// the view was aligned, each where there is one.
    #[pyo3(signature = (view=View::Number(0)))]
    fn score<'py>(&self, py: Python<'py>, view: View) -> PyResult<Bound<'py, PyDict>> {
        let view = view.number(self.fit().scene())?;
        let score = released(py, || self.fit().score(view)).map_err(Refusal::from)?;
        let scores = PyDict::new(py);
        scores.set_item("psnr", score.psnr)?;
        scores.set_item("ssim", score.ssim)?;
        scores.set_item("silhouette_iou", score.silhouette_iou)?;
        scores.set_item("psnr_before", score.psnr_before)?;
        Ok(scores)
    }

    /// What notebooks show: what is said of it, the curve of these losses, and of some views scores and pictures.
    fn page(&self, py: Python<'_>, words: &str, losses: Vec<f64>) -> PyResult<String> {
        Ok(released(py, || fit_page(words, &losses, &self.fit()))?)
    }

    /// Saves the fit to a file, from which `Scene.fit(resume=..)` goes on to the same bits.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        Ok(released(py, || self.fit().save(path)).map_err(Refusal::from)?)
    }

    /// Writes meshes, textures, cameras and pictures of what was learnt into a folder; returns their names.
    fn save_results(&self, py: Python<'_>, folder: PathBuf) -> PyResult<Vec<PathBuf>> {
        let saved = released(py, || self.fit().learnt()?.save_results(folder));
        Ok(saved.map_err(Refusal::from)?)
    }
}

/// A picture `[H, W, 3]` as a PNG, its numbers as pixels stand for it, from 0 to 1.
#[pyfunction]
pub fn encode_png<'py>(py: Python<'py>, image: Array<'py>) -> PyResult<Bound<'py, PyBytes>> {
    let (shape, entries) = image.view::<f32>()?;
    let encoded = released(py, || {
        let image = Tensor::new(shape, entries.to_vec())?;
        let picture = scene::Picture::from_color(&image, scene::ColorSpace::Linear)?;
        Ok::<_, Refusal>(picture.encode_png(&scene::Location::new("a picture"))?)
    });
    Ok(PyBytes::new(py, &encoded?))
}
