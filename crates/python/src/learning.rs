//! Fits of functions that are written in Python.

use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, PoisonError};

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Tape, TensorError, Var};
use bokashi_fit::{
    Fit, FitError, FitSettings, Mapping, Parameter, Parameters, Pipeline, Rules, Schedule, Stepped,
    Stop, Variables, after_step,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::array::{Array, Number, to_array};
use crate::error::Refusal;

/// A fit of either type of numbers.
enum Kind {
    Single(Box<Fit<f32>>),
    Double(Box<Fit<f64>>),
}

/// A fit of a Python function's parameters.
#[pyclass(frozen, module = "bokashi")]
pub struct Learning(Mutex<Kind>);

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

/// A step: its number, the loss before its update and the milliseconds it took; or why there is none.
type Advanced = Result<(u64, f64, f64), &'static str>;

fn advance<T: Number>(
    fit: &mut Fit<T>,
    py: Python<'_>,
    function: &Bound<'_, PyAny>,
) -> PyResult<Advanced> {
    let names = fit.parameters().iter().map(|parameter| parameter.name().to_owned()).collect();
    let mut pipeline = Function { py, function: function.clone(), names, raised: None };
    let mut done = None;
    let mut listener = after_step(|stepped: &Stepped| {
        done = Some((stepped.step, stepped.loss, stepped.ms));
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
        let value = bokashi_core::Tensor::new(shape, entries.to_vec()).map_err(Refusal::from)?;
        let parameter = Parameter::new(name, value).rate(*rate).mapping(mapping(word)?);
        parameters = parameters.with(parameter).map_err(Refusal::from)?;
    }
    Ok(parameters)
}

/// The same for either type of numbers.
macro_rules! each_kind {
    ($learning:expr, $fit:ident => $body:expr) => {
        match &mut *$learning.0.lock().unwrap_or_else(PoisonError::into_inner) {
            Kind::Single($fit) => $body,
            Kind::Double($fit) => $body,
        }
    };
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
        Ok(Self(Mutex::new(kind)))
    }

    /// Does a step of `function`, which takes a dictionary of arrays and returns a loss and a dictionary of gradients: the
    /// step's number, the loss before its update and the milliseconds it took; or in words why there is none.
    fn step<'py>(
        &self,
        py: Python<'py>,
        function: Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        match each_kind!(self, fit => advance(fit, py, &function))? {
            Ok(done) => Ok(done.into_pyobject(py)?.into_any()),
            Err(stop) => Ok(stop.into_pyobject(py)?.into_any()),
        }
    }

    /// How many steps there are.
    #[getter]
    fn steps(&self) -> u64 {
        each_kind!(self, fit => fit.settings().steps)
    }

    /// How many steps are done.
    #[getter]
    fn steps_done(&self) -> u64 {
        each_kind!(self, fit => fit.steps_done())
    }

    /// What is learnt, by name.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let parameters = PyDict::new(py);
        each_kind!(self, fit => for parameter in fit.parameters().iter() {
            parameters.set_item(parameter.name(), to_array(py, parameter.value())?)?;
        });
        Ok(parameters)
    }
}
