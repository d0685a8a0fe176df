//! Arbitrary files as saved fits.

use std::collections::{BTreeMap, HashMap};

use bokashi_core::{Tape, Var};
use bokashi_fit::{Fit, FitError, Pipeline, Stored, Variables};
use bokashi_paper::{CubePipeline, CubeSettings};
use safetensors::SafeTensors;

/// Reads the saved fit that `bytes` are: as they come or, so that the checksum does not keep all
/// changes out, with the right one. Returns the bytes of what was read.
pub fn saved(bytes: &[u8]) -> usize {
    let Some((&how, bytes)) = bytes.split_first() else { return 0 };
    let file = match how % 4 {
        0 | 1 => bytes.to_vec(),
        _ => sealed(bytes).unwrap_or_default(),
    };
    let cube = CubeSettings::of_saved(&file);
    match how % 2 {
        0 => resume::<f32>(&file, cube.ok()),
        _ => resume::<f64>(&file, cube.ok()),
    }
}

/// The file with the checksum that its contents have, where it is a safetensors file with our text.
fn sealed(file: &[u8]) -> Option<Vec<u8>> {
    const BEFORE: &str = "{\"checksum\":\"";
    let (_, header) = SafeTensors::read_metadata(file).ok()?;
    let text = header.metadata().as_ref()?.get("bokashi_fit")?;
    let (_, rest) = text.strip_prefix(BEFORE)?.split_at_checked(8)?;
    let tensors = SafeTensors::deserialize(file).ok()?.tensors();
    let tensors: BTreeMap<_, _> = tensors.into_iter().collect();
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(rest.as_bytes());
    for (name, tensor) in &tensors {
        hasher.update(format!("{name}{}{:?}", tensor.dtype(), tensor.shape()).as_bytes());
        hasher.update(tensor.data());
    }
    let text = format!("{BEFORE}{:08x}{rest}", hasher.finalize());
    let metadata = HashMap::from([("bokashi_fit".to_owned(), text)]);
    safetensors::serialize(&tensors, Some(metadata)).ok()
}

fn resume<T: Stored>(file: &[u8], cube: Option<CubeSettings>) -> usize {
    let Ok(mut fit) = Fit::<T>::from_bytes(file) else { return 0 };
    let again = fit.to_bytes().expect("what was read can be written");
    let back = Fit::<T>::from_bytes(&again).expect("what was written can be read");
    assert_eq!(back.to_bytes().as_ref(), Ok(&again));

    // Whatever the moments and rates are, a step is done or refused and leaves finite values.
    let done = fit.step(&mut Squares);
    for parameter in fit.parameters().iter() {
        assert!(parameter.value().is_finite(), "{:?} after {done:?}", parameter.name());
    }
    // The cube takes a step with its own parameters and refuses others.
    if let Some(settings) = cube.filter(|settings| settings.resolution <= 16)
        && let Ok((mut pipeline, _)) = CubePipeline::<T>::new(&settings)
    {
        let _ = Fit::<T>::from_bytes(file).expect("as before").step(&mut pipeline);
    }
    again.len()
}

/// The sum of the squares of all values; takes any state back.
struct Squares;

impl<T: Stored> Pipeline<T> for Squares {
    type Measure = ();

    fn restore_state(&mut self, _state: &[u8]) -> Result<(), FitError> {
        Ok(())
    }

    fn loss<'t>(
        &mut self,
        tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError> {
        let zero = tape.leaf_scalar(T::ZERO);
        Ok(variables.iter().fold(zero, |sum, value| sum + value.square().sum()))
    }
}
