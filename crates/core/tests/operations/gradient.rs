use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Tape, Tensor, TensorError};

/// `y = [x, x_0]`; counts how often it could take over the gradient of y.
struct Appends(Arc<AtomicUsize>);

impl Op<f64> for Appends {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "appends"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, f64>,
        outputs: &mut Outputs<'_, f64>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let x = inputs.data(0);
        let y = outputs.push([x.len() + 1]);
        y[..x.len()].copy_from_slice(x);
        y[x.len()] = x[0];
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, f64>) -> Keep {
        Keep::NOTHING.upstream()
    }

    fn backward(
        &self,
        kept: &Kept<'_, f64>,
        _saved: &mut (),
        gradients: &mut Accumulators<'_, f64>,
    ) {
        let mut y_bar = match gradients.take_upstream() {
            Some(y_bar) => {
                self.0.fetch_add(1, Ordering::Relaxed);
                y_bar
            }
            None => kept.only_upstream().to_vec(),
        };
        let last = y_bar.pop().expect("y is longer than x");
        y_bar[0] += last;
        gradients.give(0, y_bar);
    }
}

#[test]
fn a_gradient_is_taken_over_unless_somebody_else_reads_it() {
    let mut tape = Tape::new();
    let count = Arc::new(AtomicUsize::new(0));
    let numbers = Tensor::from_flat_fn([3], |k| 1.0 + k as f64);
    // Steps in the memory of earlier ones, each with several passes over one recording.
    for step in 1..4 {
        let taken = || count.swap(0, Ordering::Relaxed);
        {
            let x = tape.leaf(&numbers);
            let y = tape.apply(Appends(Arc::clone(&count)), &[x]).unwrap();
            // Two read y, and two read x.
            let loss = y.square().sum() + y.sum() + x.sum();
            let of_y = [3.0, 5.0, 7.0, 3.0];
            let of_x = [7.0, 6.0, 8.0];
            for _ in 0..2 {
                assert_eq!(loss.backward().unwrap().get(x).unwrap().data(), of_x);
                assert_eq!(taken(), 1, "{step}");
                let both = loss.backward_to(&[x, y]).unwrap();
                assert_eq!(both.get(y).unwrap().data(), of_y);
                assert_eq!(both.get(x).unwrap().data(), of_x);
                assert_eq!(taken(), 0, "whoever asked has it");
            }
            let upstream = Tensor::from_flat_fn([4], |k| k as f64);
            for _ in 0..2 {
                let gradients = tape.vjp(&[(y, &upstream)]).unwrap();
                assert_eq!(gradients.get(x).unwrap().data(), [3.0, 1.0, 2.0]);
                assert_eq!(taken(), 0, "it is the caller's");
            }
            let twice = tape.vjp(&[(y, &upstream), (y, &upstream)]).unwrap();
            assert_eq!(twice.get(x).unwrap().data(), [6.0, 2.0, 4.0]);
            assert_eq!(taken(), 1);
            assert_eq!(upstream.data(), [0.0, 1.0, 2.0, 3.0]);
            assert_eq!(y.value().data(), [1.0, 2.0, 3.0, 1.0]);
        }
        assert!(tape.take_report().left_out.iter().all(|of| of.name != "appends"));
        tape.reset();
    }
}

/// The sum of the squares; its gradient is known since the forward pass, and is given away.
struct Squares;

impl Op<f64> for Squares {
    type Saved = Option<Vec<f64>>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "squares"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, f64>,
        outputs: &mut Outputs<'_, f64>,
        slopes: &mut Option<Vec<f64>>,
    ) -> Result<(), TensorError> {
        let x = inputs.data(0);
        let slopes = slopes.get_or_insert_with(|| outputs.buffer(x.len()));
        slopes.iter_mut().zip(x).for_each(|(slope, x)| *slope = 2.0 * x);
        outputs.push([])[0] = x.iter().map(|x| x * x).sum();
        Ok(())
    }

    fn backward(
        &self,
        _kept: &Kept<'_, f64>,
        slopes: &mut Option<Vec<f64>>,
        gradients: &mut Accumulators<'_, f64>,
    ) {
        gradients.give(0, slopes.take().expect("one pass"));
    }
}

#[test]
fn what_is_given_to_a_gradient_is_its_buffer_unless_there_is_a_sum_and_serves_the_next_step() {
    let mut tape = Tape::new();
    let mut places = BTreeSet::new();
    for _ in 0..8 {
        {
            let x = tape.leaf(&Tensor::from_flat_fn([100], |k| k as f64));
            let y = x.square();
            let loss = tape.apply(Squares, &[y]).unwrap();
            let gradients = loss.backward_to(&[y]).unwrap();
            let of_y = gradients.get(y).unwrap();
            assert!(of_y.data().iter().zip(y.value().data()).all(|(bar, y)| *bar == 2.0 * y));
            places.insert(of_y.data().as_ptr());
            drop(gradients);
            // A sum that is there already.
            let loss = tape.apply(Squares, &[x]).unwrap() + x.sum();
            let gradients = loss.backward().unwrap();
            let of_x = gradients.get(x).unwrap().data();
            assert!(of_x.iter().enumerate().all(|(k, &bar)| bar == 2.0 * k as f64 + 1.0));
        }
        tape.reset();
    }
    assert!(places.len() <= 3, "{places:?}");
}
