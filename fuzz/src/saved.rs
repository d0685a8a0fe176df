//! Arbitrary files as saved fits.

use bokashi_core::{Tape, Var};
use bokashi_fit::scenes::{CubePipeline, CubeSettings};
use bokashi_fit::{Fit, FitError, Pipeline, Stored, Variables};

/// Reads the saved fit that `bytes` are: as they come or, so that the checksum does not keep all
/// changes out, as the contents of a file with a right one. Returns the bytes of what was read.
pub fn saved(bytes: &[u8]) -> usize {
    let Some((&how, bytes)) = bytes.split_first() else { return 0 };
    let file = match how % 4 {
        0 | 1 => bytes.to_vec(),
        2 => sealed("f32", bytes),
        _ => sealed("f64", bytes),
    };
    let cube = CubeSettings::of_saved(&file);
    match how % 2 {
        0 => resume::<f32>(&file, cube.ok()),
        _ => resume::<f64>(&file, cube.ok()),
    }
}

fn sealed(precision: &str, contents: &[u8]) -> Vec<u8> {
    let mut file = format!("bokashi-fit 1 {precision}\n").into_bytes();
    file.extend((contents.len() as u64).to_le_bytes());
    file.extend(contents);
    let checksum = crc32fast::hash(&file);
    file.extend(checksum.to_le_bytes());
    file
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
        &self,
        tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError> {
        let zero = tape.leaf_scalar(T::ZERO);
        Ok(variables.iter().fold(zero, |sum, value| sum + value.square().sum()))
    }
}
