//! An operation of one's own: the Huber loss, a parabola near 0 and a straight line far out.
//!
//! A line is fitted to points one of which is wild. `Huber` is written against [`Op`], the same
//! trait that the built-in operations implement, and composes with them.

use bokashi::prelude::*;

/// `L = sum_k h(x_k)`, with `h(x) = x^2 / 2` for `|x| <= width`, else `width (|x| - width / 2)`;
/// `x_bar_k += clamp(x_k, -width, width) L_bar`. Smooth to first order everywhere.
struct Huber {
    width: f64,
}

impl Op<f64> for Huber {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "huber"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, f64>,
        outputs: &mut Outputs<'_, f64>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let terms = inputs.data(0).iter().map(|x| {
            let near = x.abs().min(self.width);
            near * (x.abs() - near / 2.0)
        });
        outputs.push([])[0] = terms.sum();
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, f64>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(&self, kept: &Kept<'_, f64>, _: &mut (), gradients: &mut Accumulators<'_, f64>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let (x, loss_bar) = (kept.input(0), kept.only_upstream()[0]);
        x_bar.add_each(|k| x[k].clamp(-self.width, self.width) * loss_bar);
    }
}

/// The Huber loss of a line with `[slope, intercept]` through the points, of shape `[]`.
fn loss<'t>(
    tape: &'t Tape<f64>,
    line: Var<'t, f64>,
    points: [&Tensor<f64>; 2],
) -> Result<Var<'t, f64>, TensorError> {
    let [x, y] = points.map(|axis| tape.constant(axis));
    let (slope, intercept) = (line.slice(0, 0..1)?, line.slice(0, 1..2)?);
    tape.apply(Huber { width: 0.5 }, &[slope * x + intercept - y])
}

fn main() -> Result<(), TensorError> {
    let x = Tensor::new([5], vec![0.0, 1.0, 2.0, 3.0, 4.0])?;
    let y = Tensor::new([5], vec![1.1, 2.9, 5.0, 40.0, 9.1])?;
    let mut line = Tensor::new([2], vec![1.5, 0.5])?;

    let tape = Tape::new();
    let variable = tape.leaf(&line);
    let value = loss(&tape, variable, [&x, &y])?;
    let gradients = value.backward()?;
    let gradient = gradients.get_or_zeros(variable);
    println!("loss {:.6}, gradient {:.6?}", value.item(), gradient.data());

    let step = f64::EPSILON.cbrt();
    for (k, name) in ["slope", "intercept"].into_iter().enumerate() {
        let value_near = |offset: f64| {
            let mut moved = line.clone();
            moved.data_mut()[k] += offset;
            let tape = Tape::new();
            loss(&tape, tape.leaf(&moved), [&x, &y]).map(|value| value.item())
        };
        let quotient = (value_near(step)? - value_near(-step)?) / (2.0 * step);
        println!("{name}: gradient {:.6}, central difference {quotient:.6}", gradient.data()[k]);
        assert!((gradient.data()[k] - quotient).abs() < 1e-6);
    }

    let mut tape = Tape::new();
    for _ in 0..500 {
        tape.reset();
        let variable = tape.leaf_copied(&line);
        let gradients = loss(&tape, variable, [&x, &y])?.backward()?;
        let gradient = gradients.get_or_zeros(variable);
        line.data_mut().iter_mut().zip(gradient.data()).for_each(|(p, g)| *p -= 0.05 * g);
    }
    println!("fitted: y = {:.3} x + {:.3}, past the wild point", line.data()[0], line.data()[1]);
    Ok(())
}
