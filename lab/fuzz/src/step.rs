//! A step on a tape, done twice.

use bokashi_core::{Scalar, Tape, Tensor, Var};

use super::number::{all_finite, bits};

/// What a step gave: values, then the gradient of each input.
#[derive(Debug, Clone)]
struct Done<T> {
    value: Tensor<T>,
    gradients: Vec<Option<Tensor<T>>>,
}

/// Records `pipeline` on the leaves `inputs`, pulls `upstream` back, does the same again on the
/// recycled tape, and panics unless both give the same bits and, where `finite` is promised, finite
/// ones. Returns the number of values. An error of the pipeline is as good as a value, but it has
/// to come twice.
pub fn check<T: Scalar, E: std::fmt::Display>(
    inputs: &[Tensor<T>],
    finite: bool,
    upstream: impl Fn(usize) -> T,
    pipeline: impl for<'t> Fn(&'t Tape<T>, &[Var<'t, T>]) -> Result<Var<'t, T>, E>,
) -> usize {
    let mut tape = Tape::<T>::new();
    let step = |tape: &Tape<T>| {
        let leaves: Vec<_> = inputs.iter().map(|input| tape.leaf(input)).collect();
        let output = pipeline(tape, &leaves).map_err(|error| error.to_string())?;
        let value = output.value();
        if value.size() == 0 {
            return Ok(Done { value, gradients: Vec::new() });
        }
        let upstream = Tensor::from_flat_fn(value.shape().clone(), &upstream);
        let gradients = tape.vjp(&[(output, &upstream)]).map_err(|error| error.to_string())?;
        let gradients = leaves.iter().map(|&leaf| gradients.get(leaf).cloned()).collect();
        Ok::<_, String>(Done { value, gradients })
    };
    let first = step(&tape);
    tape.reset();
    let second = step(&tape);
    match (&first, &second) {
        (Ok(first), Ok(second)) => {
            assert_eq!(bits(first.value.data()), bits(second.value.data()), "values, again");
            for (first, second) in first.gradients.iter().zip(&second.gradients) {
                let bits_of = |gradient: &Option<Tensor<T>>| {
                    gradient.as_ref().map(|gradient| bits(gradient.data()))
                };
                assert_eq!(bits_of(first), bits_of(second), "gradients, again");
            }
        }
        (Err(first), Err(second)) => assert_eq!(first, second),
        _ => panic!("an error the one time and none the other: {first:?} {second:?}"),
    }
    let Ok(done) = first else { return 0 };
    if finite {
        assert!(all_finite(done.value.data()), "values: {:?}", done.value);
        for gradient in done.gradients.iter().flatten() {
            assert!(all_finite(gradient.data()), "gradient: {gradient:?}");
        }
    }
    done.value.size()
}
