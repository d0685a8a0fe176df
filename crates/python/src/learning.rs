//! Fits of functions that are written in Python.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Tape, Tensor, TensorError, Var};
use bokashi_fit::{
    Fit, FitError, FitSettings, Mapping, Parameter, Parameters, Pipeline, Rules, Schedule, Stepped,
    Stop, Variables, after_step,
};
use pyo3::exceptions::{PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::array::{Array, Number};
use crate::error::Refusal;

/// A fit of either type of numbers.
enum Kind {
    Single(Box<Fit<f32>>),
    Double(Box<Fit<f64>>),
}

/// A fit of a Python function's parameters.
#[pyclass(frozen, module = "bokashi")]
pub struct Learning {
    /// Not here while a step is under way: Python runs in it, and may ask for anything.
    fit: Mutex<Option<Kind>>,
    steps: u64,
    done: AtomicU64,
}

/// A loss that Python told, and its gradients. Inputs: the parameters. Output: `[]`.
struct GivenLoss<T> {
    loss: T,
    gradients: Vec<Option<Arc<Vec<T>>>>,
}

impl<T: Number> Op<T> for GivenLoss<T> {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "pipeline"
    }

    fn forward(
        &self,
        _inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        outputs.push([])[0] = self.loss;
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let factor = kept.only_upstream()[0];
        for (i, gradient) in self.gradients.iter().enumerate() {
            if let Some(gradient) = gradient {
                gradients.lend_scaled(i, factor, gradient);
            }
        }
    }
}

/// A Python function as a pipeline: of a dictionary of arrays, it returns a loss and a dictionary of gradients.
struct Function<'py> {
    py: Python<'py>,
    function: Bound<'py, PyAny>,
    names: Vec<String>,
    /// What the function raised.
    raised: Option<PyErr>,
}

impl Function<'_> {
    fn call<T: Number>(&self, variables: &Variables<'_, T>) -> PyResult<GivenLoss<T>> {
        let parameters = PyDict::new(self.py);
        for name in &self.names {
            let value = variables.get(name).map_err(Refusal::from)?.value();
            parameters.set_item(name, T::to_array(self.py, value)?)?;
        }
        let (loss, told): (f64, Bound<'_, PyDict>) =
            self.function.call1((parameters,))?.extract()?;
        let mut gradients = Vec::new();
        for name in &self.names {
            let gradient: Option<Array<'_>> = match told.get_item(name)? {
                Some(gradient) => gradient.extract()?,
                None => None,
            };
            let Some(gradient) = gradient else {
                gradients.push(None);
                continue;
            };
            let (shape, entries) = gradient.view::<T>()?;
            let expected = variables.get(name).map_err(Refusal::from)?.shape();
            if *shape != *expected {
                return Err(PyValueError::new_err(format!(
                    "the gradient of {name:?} needs shape {expected}, got {shape:?}"
                )));
            }
            gradients.push(Some(Arc::new(entries.to_vec())));
        }
        if let Some(other) = told
            .keys()
            .iter()
            .find(|name| !self.names.iter().any(|own| name.eq(own).unwrap_or(false)))
        {
            return Err(PyValueError::new_err(format!(
                "gradients need the names of parameters, {:?}, got {:?}",
                self.names,
                other.str()?.to_string()
            )));
        }
        Ok(GivenLoss { loss: T::from_f64(loss), gradients })
    }
}

impl<T: Number> Pipeline<T> for Function<'_> {
    type Measure = ();

    fn loss<'t>(
        &mut self,
        tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError> {
        match self.call(variables) {
            Ok(told) => {
                let inputs = self.names.iter().map(|name| variables.get(name));
                Ok(tape.apply(told, &inputs.collect::<Result<Vec<_>, _>>()?)?)
            }
            Err(raised) => {
                self.raised = Some(raised);
                // Nobody sees it: what was raised is raised again.
                Err(TensorError::NotScalar { shape: [0].into() }.into())
            }
        }
    }
}

/// The loss before a step's update and the milliseconds that the step took; or why there is none.
type Advanced = Result<(f64, f64), &'static str>;

fn advance<T: Number>(
    fit: &mut Fit<T>,
    py: Python<'_>,
    function: &Bound<'_, PyAny>,
) -> PyResult<Advanced> {
    let names = fit.parameters().iter().map(|parameter| parameter.name().to_owned()).collect();
    let mut pipeline = Function { py, function: function.clone(), names, raised: None };
    let mut done = None;
    let mut listener = after_step(|stepped: &Stepped| {
        done = Some((stepped.loss, stepped.ms));
        ControlFlow::Continue(())
    });
    let rules = Rules { steps: Some(fit.steps_done() + 1), ..Rules::default() };
    let stop = fit.drive(&mut pipeline, &rules, &mut [&mut listener]);
    if let Some(raised) = pipeline.raised {
        return Err(raised);
    }
    let stop = stop.map_err(Refusal::from)?;
    Ok(done.ok_or(match stop {
        Stop::LossBelow => "the loss fell below the limit",
        Stop::NoProgress => "the loss found no new minimum",
        _ => "its steps are done",
    }))
}

fn mapping(word: &str) -> PyResult<Mapping> {
    match word {
        "identity" => Ok(Mapping::Identity),
        "softplus" => Ok(Mapping::Softplus),
        "exp" => Ok(Mapping::Exp),
        "sigmoid" => Ok(Mapping::Sigmoid),
        _ => {
            let message =
                format!("mapping needs to be identity, softplus, exp or sigmoid, got {word:?}");
            Err(PyValueError::new_err(message))
        }
    }
}

/// A name, its start, its rate and its mapping.
type Given<'py> = (String, Array<'py>, f64, String);

fn parameters<T: Number>(given: &[Given<'_>]) -> PyResult<Parameters<T>> {
    let mut parameters = Parameters::new();
    for (name, value, rate, word) in given {
        let (shape, entries) = value.view::<T>()?;
        let value = Tensor::new(shape, entries.to_vec()).map_err(Refusal::from)?;
        let parameter = Parameter::new(name, value).rate(*rate).mapping(mapping(word)?);
        parameters = parameters.with(parameter).map_err(Refusal::from)?;
    }
    Ok(parameters)
}

/// The fit, taken out for a step; put back whatever happens.
struct Taken<'a> {
    from: &'a Learning,
    kind: Option<Kind>,
}

impl<'a> Taken<'a> {
    fn new(from: &'a Learning) -> PyResult<Self> {
        let kind = from.fit.lock().unwrap_or_else(PoisonError::into_inner).take();
        if kind.is_none() {
            return Err(PyRuntimeError::new_err(
                "a fit does one step at a time, and was called from its own pipeline or another thread",
            ));
        }
        Ok(Self { from, kind })
    }
}

impl Drop for Taken<'_> {
    fn drop(&mut self) {
        *self.from.fit.lock().unwrap_or_else(PoisonError::into_inner) = self.kind.take();
    }
}

/// What is learnt, by name.
fn learnt<T: Number>(fit: &Fit<T>) -> Vec<(String, Tensor<T>)> {
    fit.parameters()
        .iter()
        .map(|parameter| (parameter.name().to_owned(), parameter.value()))
        .collect()
}

fn to_dict<T: Number>(
    py: Python<'_>,
    learnt: Vec<(String, Tensor<T>)>,
) -> PyResult<Bound<'_, PyDict>> {
    let parameters = PyDict::new(py);
    for (name, value) in learnt {
        parameters.set_item(name, T::to_array(py, value)?)?;
    }
    Ok(parameters)
}

#[pymethods]
impl Learning {
    /// A fit by Adam. Rates stay, or fall along half a cosine to the share `floor`.
    #[new]
    #[pyo3(signature = (parameters, steps, cosine=false, floor=0.0, loss_below=None, patience=None))]
    fn new(
        parameters: Vec<Given<'_>>,
        steps: u64,
        cosine: bool,
        floor: f64,
        loss_below: Option<f64>,
        patience: Option<u64>,
    ) -> PyResult<Self> {
        let schedule = if cosine { Schedule::Cosine { steps, floor } } else { Schedule::Constant };
        let settings =
            FitSettings { steps, schedule, loss_below, patience, ..FitSettings::default() };
        let Some((_, first, ..)) = parameters.first() else {
            return Err(PyValueError::new_err("a fit needs at least one parameter, got none"));
        };
        let kind = match first {
            Array::Single(_) => Kind::Single(Box::new(
                Fit::new(self::parameters(&parameters)?, settings).map_err(Refusal::from)?,
            )),
            Array::Double(_) => Kind::Double(Box::new(
                Fit::new(self::parameters(&parameters)?, settings).map_err(Refusal::from)?,
            )),
            Array::Dual(_) => {
                return Err(PyTypeError::new_err("a fit learns plain numbers, got tangents"));
            }
        };
        Ok(Self { fit: Mutex::new(Some(kind)), steps, done: AtomicU64::new(0) })
    }

    /// Does a step of `function`, which takes a dictionary of arrays and returns a loss and a dictionary of gradients. The
    /// loss before its update and the milliseconds it took come to the end of the lists: before any signal is seen.
    /// Returns in words why there is no step, or `None`.
    fn step<'py>(
        &self,
        py: Python<'py>,
        function: Bound<'py, PyAny>,
        losses: &Bound<'py, PyList>,
        milliseconds: &Bound<'py, PyList>,
    ) -> PyResult<Option<&'static str>> {
        let mut taken = Taken::new(self)?;
        let (advanced, done) = match taken.kind.as_mut().expect("it was just taken") {
            Kind::Single(fit) => (advance(fit, py, &function)?, fit.steps_done()),
            Kind::Double(fit) => (advance(fit, py, &function)?, fit.steps_done()),
        };
        self.done.store(done, Ordering::Relaxed);
        let (loss, ms) = match advanced {
            Ok(done) => done,
            Err(stop) => return Ok(Some(stop)),
        };
        losses.append(loss)?;
        milliseconds.append(ms)?;
        Ok(None)
    }

    /// How many steps there are.
    #[getter]
    fn steps(&self) -> u64 {
        self.steps
    }

    /// How many steps are done.
    #[getter]
    fn steps_done(&self) -> u64 {
        self.done.load(Ordering::Relaxed)
    }

    /// What is learnt, by name. Not to be had while a step is under way: its function is given it.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        // Arrays are made when the lock is free again: Python may run there, and other threads of it.
        let (single, double) = match &*self.fit.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(Kind::Single(fit)) => (Some(learnt(fit)), None),
            Some(Kind::Double(fit)) => (None, Some(learnt(fit))),
            None => (None, None),
        };
        match (single, double) {
            (Some(learnt), _) => to_dict(py, learnt),
            (_, Some(learnt)) => to_dict(py, learnt),
            _ => Err(PyRuntimeError::new_err(
                "parameters can be had between two steps, and a step is under way",
            )),
        }
    }
}
