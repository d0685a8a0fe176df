//! Fits over a set of views: the mean of the losses of all views, or of some that each step draws.
//!
//! Each view is recorded on a tape of its own ([`Tape::sum_over`]), and its backward pass runs at once.
//! So views are computed at the same time, and memory is that of the views under way. Values and gradients
//! are added in a tree over the views' indices, so the bits are the same for any number of threads.
//!
//! The views can be divided among the ranks of a job ([`Views::among`]). Each rank then computes its own,
//! and the sums of all ranks are added in the same tree. So the bits are the same for any number of ranks.

use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use bokashi_core::mixing::{GOLDEN, mixed};
use bokashi_core::{Scalar, Tape, Var};

use crate::communicator::{Alone, Communicator, Ranks, block};
use crate::error::{FitError, Quantity};
use crate::parameter::Variables;
use crate::pipeline::Pipeline;
use crate::reduction::{Reduced, reduced};

/// A view in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct View {
    /// The index of the view, from 0.
    pub index: usize,
    /// The number of updates before the step.
    pub step: u64,
}

/// A [`Pipeline`] over a set of views: see [`views`].
#[derive(Clone)]
pub struct Views<T, F> {
    loss: F,
    count: usize,
    per_step: usize,
    seed: u64,
    step: u64,
    /// The views of the step, in the order of their indices.
    chosen: Vec<usize>,
    /// The job's ranks, where there are several.
    ranks: Option<Ranks<T>>,
    /// What all ranks together sent in the last step, in bytes.
    sent: u64,
    numbers: PhantomData<fn(T)>,
}

impl<T, F: fmt::Debug> fmt::Debug for Views<T, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { loss, count, per_step, seed, step, chosen, ranks, .. } = self;
        let mut all = f.debug_struct("Views");
        all.field("loss", loss).field("count", count).field("per_step", per_step);
        all.field("seed", seed).field("step", step).field("chosen", chosen);
        all.field("ranks", ranks).finish_non_exhaustive()
    }
}

/// Makes a [`Pipeline`] of the loss of a view. The loss of the pipeline is the mean over `count` views.
///
/// `loss` is called from several threads at once. Each view has its own tape and variables; captured variables are
/// shared by all views.
///
/// ```
/// use bokashi_core::Tensor;
/// use bokashi_fit::{Fit, FitSettings, Parameter, Parameters, squared_error, views};
///
/// // A point, seen along four directions.
/// let directions = [[1.0, 0.0], [0.0, 1.0], [0.6, 0.8], [0.8, -0.6]];
/// let seen = directions.map(|d| 3.0 * d[0] - 2.0 * d[1]);
/// let mut pipeline = views(4, |view, tape, variables| {
///     let direction = tape.constant(&Tensor::new([2], directions[view.index].to_vec())?);
///     let coordinate = variables.get("point")?.dot(direction)?;
///     Ok(squared_error(coordinate, tape.constant_scalar(seen[view.index]))?)
/// })
/// .per_step(2)
/// .seed(7);
/// let point = Parameter::new("point", Tensor::zeros([2])).rate(0.1);
/// let mut fit = Fit::<f64>::new(Parameters::new().with(point)?, FitSettings::default())?;
/// fit.run(&mut pipeline)?;
/// assert!((fit.parameters().value("point")?.data()[0] - 3.0).abs() < 1e-3);
/// # Ok::<(), bokashi_fit::FitError>(())
/// ```
pub fn views<T, F>(count: usize, loss: F) -> Views<T, F>
where
    T: Scalar,
    F: for<'t> Fn(View, &'t Tape<T>, &Variables<'t, T>) -> Result<Var<'t, T>, FitError> + Sync,
{
    Views {
        loss,
        count,
        per_step: count,
        seed: 0,
        step: 0,
        chosen: Vec::new(),
        ranks: None,
        sent: 0,
        numbers: PhantomData,
    }
}

impl<T, F> Views<T, F> {
    /// The pipeline with so many views per step, drawn anew in each step. The views of a step follow from the seed and
    /// the number of the step.
    #[must_use]
    pub fn per_step(self, per_step: usize) -> Self {
        Self { per_step, ..self }
    }

    /// The pipeline with a seed for the views that each step draws; 0 by default.
    #[must_use]
    pub fn seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// The pipeline with its views divided among the ranks of a job, all of which make the same calls. Each rank
    /// computes the losses of its [`block`] of views, and all ranks return the mean.
    #[must_use]
    pub fn among(self, ranks: Ranks<T>) -> Self {
        // Alone, nobody is asked.
        Self { ranks: Some(ranks).filter(|ranks| ranks.size() > 1), ..self }
    }

    /// The number of bytes that all ranks together sent in the last step.
    pub fn bytes_sent(&self) -> u64 {
        self.sent
    }

    /// The indices of the views of the last step that was prepared.
    pub fn chosen(&self) -> &[usize] {
        &self.chosen
    }

    /// The loss of the k-th view of the step.
    fn view_loss<'p>(
        &self,
        k: usize,
        tape: &'p Tape<T>,
        names: &Arc<[String]>,
        inputs: &[Var<'p, T>],
    ) -> Result<Var<'p, T>, FitError>
    where
        T: Scalar,
        F: for<'t> Fn(View, &'t Tape<T>, &Variables<'t, T>) -> Result<Var<'t, T>, FitError> + Sync,
    {
        let view = View { index: self.chosen[k], step: self.step };
        let variables = Variables::from_leaves(names, inputs);
        let loss = (self.loss)(view, tape, &variables).and_then(|loss| {
            // Here its operations are known.
            if loss.shape().size() == 1 && !loss.item().is_finite() {
                let (value, origin) = (loss.item().to_f64(), variables.origin_on(tape));
                let (quantity, step) = (Quantity::Loss, view.step);
                return Err(FitError::NotFinite { quantity, value, step, origin });
            }
            Ok(loss)
        });
        loss.map_err(|error| FitError::View { view: view.index, error: Box::new(error) })
    }

    fn check(&self) -> Result<(), FitError> {
        let Self { count, per_step, .. } = *self;
        if count == 0 {
            return Err(FitError::setting("views", "at least 1 view", count));
        }
        if !(1..=count).contains(&per_step) {
            let value = format!("{per_step} of {count}");
            return Err(FitError::setting("views per step", "from 1 to all views", value));
        }
        Ok(())
    }

    /// The state that a resumed fit must share: the number of views, how many a step draws, and the seed.
    #[cfg(feature = "save")]
    fn state(&self) -> [u8; 24] {
        let words = [self.count as u64, self.per_step as u64, self.seed];
        std::array::from_fn(|k| words[k / 8].to_le_bytes()[k % 8])
    }
}

impl<T, F> Pipeline<T> for Views<T, F>
where
    T: Scalar,
    F: for<'t> Fn(View, &'t Tape<T>, &Variables<'t, T>) -> Result<Var<'t, T>, FitError> + Sync,
{
    type Measure = ();

    fn prepare(&mut self, step: u64) -> Result<(), FitError> {
        self.check()?;
        self.step = step;
        draw(&mut self.chosen, self.count, self.per_step, self.seed, step);
        Ok(())
    }

    #[cfg(feature = "save")]
    fn save_state(&self, state: &mut Vec<u8>) {
        state.extend(self.state());
    }

    #[cfg(feature = "save")]
    fn restore_state(&mut self, state: &[u8]) -> Result<(), FitError> {
        if state == self.state() {
            return Ok(());
        }
        let words = |state: &[u8]| {
            let mut words = state.chunks(8).map(|word| {
                word.try_into()
                    .map_or_else(|_| "?".into(), |word| u64::from_le_bytes(word).to_string())
            });
            let mut next = || words.next().unwrap_or_default();
            let (count, per_step, seed) = (next(), next(), next());
            format!("{per_step} of {count} views per step from seed {seed}")
        };
        Err(FitError::saved(words(&self.state()), words(state)))
    }

    fn ranks(&self) -> &dyn Communicator<T> {
        self.ranks.as_deref().unwrap_or(&Alone)
    }

    fn loss<'t>(
        &mut self,
        tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError> {
        let this = &*self;
        // Variables are bound to their thread, names are not.
        let (names, inputs) = (&variables.names, variables.iter().collect::<Vec<_>>());
        let count = this.chosen.len();
        let (sum, sent) = match &this.ranks {
            None => {
                let sum = tape.sum_over(count, &inputs, |k, tape, inputs| {
                    this.view_loss(k, tape, names, inputs)
                });
                (sum?, 0)
            }
            Some(ranks) => {
                // Of each rank, the first of its views that the step has.
                let size = ranks.size();
                let first = |rank| {
                    let views = block(this.count, rank, size);
                    this.chosen.partition_point(|&view| view < views.start)
                };
                let bounds: Vec<_> = (0..size).map(first).chain([count]).collect();
                let parts = bounds[ranks.rank()]..bounds[ranks.rank() + 1];
                let sums = tape.partial_sums(count, parts, &inputs, |k, tape, inputs| {
                    this.view_loss(k, tape, names, inputs)
                });
                let shape = |x: &Var<'t, T>| x.needs_gradient().then(|| x.shape());
                let shapes: Vec<_> = inputs.iter().map(shape).collect();
                let Reduced { sum, bytes } = reduced(&**ranks, &bounds, &shapes, sums)?;
                (tape.sum_of(&inputs, sum)?, bytes)
            }
        };
        self.sent = sent;
        Ok(sum * T::from_f64(1.0 / count as f64))
    }
}

/// Sets `chosen` to the indices of the views of a step, in ascending order. They are the first entries of a permutation
/// (Fisher and Yates) by numbers that follow from seed and step.
fn draw(chosen: &mut Vec<usize>, count: usize, per_step: usize, seed: u64, step: u64) {
    chosen.clear();
    chosen.extend(0..count);
    if per_step == count {
        return;
    }
    // Seed and step go through the generator's own mixing, so that neighbours have nothing in common.
    let mut state = mixed(mixed(seed) ^ step);
    for k in 0..per_step {
        state = state.wrapping_add(GOLDEN);
        let range = (count - k) as u128;
        // Of a range far below 2^64, each number is as likely as the next.
        let below = (u128::from(mixed(state)) * range) >> 64;
        chosen.swap(k, k + below as usize);
    }
    chosen.truncate(per_step);
    chosen.sort_unstable();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Origin;
    use crate::in_memory::on_ranks;
    use crate::parameter::{Parameter, Parameters};
    use crate::{Fit, FitSettings, Stop};
    use bokashi_core::Tensor;

    fn fit(settings: FitSettings) -> Fit<f64> {
        let x = Tensor::from_flat_fn([5], |k| 0.1 * k as f64);
        let parameters = Parameters::new()
            .with(Parameter::new("x", x).rate(0.03))
            .and_then(|list| list.with(Parameter::new("still", Tensor::scalar(2.0)).frozen()));
        Fit::new(parameters.unwrap(), settings).unwrap()
    }

    /// A loss that differs from view to view and from step to step.
    fn loss<'t>(view: View, x: Var<'t, f64>) -> Var<'t, f64> {
        (x * (view.index as f64 + 0.5)).sin().sum() + view.step as f64
    }

    #[test]
    fn the_loss_is_the_mean_over_the_chosen_views_and_so_is_the_gradient() {
        let mut apart =
            views(7, |view, _, variables| Ok(loss(view, variables.get("x")?))).per_step(3).seed(5);
        for step in 0..4 {
            Pipeline::<f64>::prepare(&mut apart, step).unwrap();
            let chosen = apart.chosen().to_vec();
            let fit = fit(FitSettings::default());
            let by_views = fit.tape();
            let variables = fit.parameters().record(by_views);
            let found = apart.loss(by_views, &variables).unwrap();
            let terms = chosen.iter().map(|&index| loss(View { index, step }, variables[0]));
            let expected = terms.reduce(|sum, term| sum + term).unwrap() / 3.0;
            assert!((found.item() - expected.item()).abs() < 1e-12);
            let (found, expected) = (found.backward().unwrap(), expected.backward().unwrap());
            let [found, expected] =
                [found, expected].map(|all| all.get_or_zeros(variables.list[0].raw));
            for (found, expected) in found.data().iter().zip(expected.data()) {
                assert!((found - expected).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn each_view_is_drawn_as_often_as_any_other_and_none_twice_in_a_step() {
        let (count, per_step, steps) = (9, 4, 20_000);
        let mut times = vec![0_u32; count];
        let mut pairs = vec![0_u32; count * count];
        let mut chosen = Vec::new();
        for step in 0..steps {
            draw(&mut chosen, count, per_step, 3, step);
            assert_eq!(chosen.len(), per_step);
            assert!(chosen.is_sorted_by(|a, b| a < b) && chosen.iter().all(|&view| view < count));
            for &a in &chosen {
                times[a] += 1;
                chosen.iter().for_each(|&b| pairs[a * count + b] += 1);
            }
        }
        // Within five standard deviations of a binomial distribution.
        let is_likely = |found: u32, p: f64| {
            let n = steps as f64;
            (f64::from(found) - n * p).abs() < 5.0 * (n * p * (1.0 - p)).sqrt()
        };
        assert!(times.iter().all(|&found| is_likely(found, 4.0 / 9.0)), "{times:?}");
        for (at, &found) in pairs.iter().enumerate().filter(|(at, _)| at / count != at % count) {
            assert!(is_likely(found, 4.0 / 9.0 * 3.0 / 8.0), "{at}: {found}");
        }
    }

    #[test]
    fn views_follow_from_seed_and_step_and_all_of_them_need_no_draw() {
        let drawn = |per_step, seed, step| {
            let mut chosen = Vec::new();
            draw(&mut chosen, 20, per_step, seed, step);
            chosen
        };
        assert_eq!(drawn(20, 1, 2), (0..20).collect::<Vec<_>>());
        assert_eq!(drawn(5, 1, 2), drawn(5, 1, 2));
        // Seed and step are not interchangeable.
        let other =
            [drawn(5, 1, 3), drawn(5, 2, 2), drawn(5, 2, 1), drawn(5, 3, 0), drawn(5, 0, 3)];
        assert!(other.iter().all(|other| *other != drawn(5, 1, 2)));
    }

    #[test]
    fn a_fit_over_drawn_views_arrives_where_a_fit_over_all_does() {
        let settings = FitSettings { steps: 400, ..FitSettings::default() };
        let center = |view: View| 1.0 + 0.01 * view.index as f64;
        let arrive = |per_step| {
            let mut fit = fit(settings);
            let mut pipeline = views(10, |view, _, variables| {
                Ok((variables.get("x")? - center(view)).square().sum())
            });
            pipeline = pipeline.per_step(per_step);
            assert_eq!(fit.run(&mut pipeline).unwrap().stop, Stop::Steps);
            fit.parameters().value("x").unwrap().data()[0]
        };
        assert!((arrive(10) - 1.045).abs() < 1e-3);
        assert!((arrive(3) - 1.045).abs() < 2e-2);
    }

    /// Losses, parameters and moments of a fit of 7 steps, to the bit; and the bytes of its last step.
    fn bits(ranks: Option<Ranks<f32>>, count: usize, per_step: usize) -> (Vec<u64>, u64) {
        // More numbers than a message has, one parameter that few views see, and one that none does.
        let list = Parameters::new()
            .with(Parameter::new("x", Tensor::from_flat_fn([70_000], |k| (k as f32).sin())))
            .and_then(|list| list.with(Parameter::new("seen", Tensor::scalar(0.5)).optional()))
            .and_then(|list| list.with(Parameter::new("unseen", Tensor::scalar(0.5)).optional()))
            .and_then(|list| list.with(Parameter::new("still", Tensor::scalar(0.5)).frozen()));
        let mut fit = Fit::<f32>::new(list.unwrap(), FitSettings::default()).unwrap();
        let mut pipeline = views(count, |view, _, variables| {
            let turned = (variables.get("x")? * (0.3 + view.index as f32)).sin();
            let loss = turned.sum() * variables.get("still")?;
            Ok(match view.index % 11 {
                5 => loss + variables.get("seen")?.exp() * turned.sum(),
                _ => loss,
            })
        });
        pipeline = pipeline.per_step(per_step).seed(3);
        if let Some(ranks) = ranks {
            pipeline = pipeline.among(ranks);
        }
        let mut found = Vec::new();
        for _ in 0..7 {
            found.push(fit.step(&mut pipeline).unwrap().loss.to_bits());
        }
        let raw = fit.parameters().iter().flat_map(|own| own.raw().data().to_vec());
        found.extend(raw.map(|x| u64::from(x.to_bits())));
        (found, pipeline.bytes_sent())
    }

    #[test]
    fn the_bits_are_the_same_on_any_number_of_ranks() {
        for (count, per_step) in [(6, 6), (13, 13), (13, 5)] {
            let (alone, none) = bits(None, count, per_step);
            assert_eq!(none, 0);
            for size in [1, 2, 3, 4, 7] {
                let of_ranks = on_ranks(size, |ranks| bits(Some(ranks), count, per_step));
                for (rank, (found, bytes)) in of_ranks.iter().enumerate() {
                    assert!(*found == alone, "{count} views: rank {rank} of {size}");
                    // Each rank but one gets the sum; sums of a few parts travel before.
                    let sum = 4.0 * 70_000.0;
                    let sums = *bytes as f64 / sum;
                    let fewest = (size - 1) as f64;
                    assert!((fewest..=3.1 * fewest).contains(&sums), "{sums} sums, {size} ranks");
                }
            }
        }
    }

    #[test]
    fn a_view_that_one_rank_refuses_ends_the_step_of_all() {
        let said = on_ranks::<f64, _>(3, |ranks| {
            let mut pipeline = views(6, |view: View, _, variables| {
                let x = variables.get("x")?;
                if view.index > 2 { Ok(x.ln().sum()) } else { Ok(x.sum()) }
            });
            pipeline = pipeline.among(ranks);
            let mut fit = fit(FitSettings::default());
            let error = fit.step(&mut pipeline).map(|_| ()).unwrap_err().to_string();
            (error, fit.steps_done())
        });
        let own = "view 3: the loss needs to be finite, got -inf at step 0, first in the output of \
                   ln of \"x\"";
        for (rank, (said, steps)) in said.into_iter().enumerate() {
            let expected = if rank == 1 { own.to_owned() } else { format!("rank 1: {own}") };
            assert_eq!((said, steps), (expected, 0));
        }
    }

    #[test]
    fn an_error_names_the_view() {
        let refused = |per_step, at: f64| {
            let mut pipeline = views(6, move |view: View, _, variables| {
                let x = variables.get("x")?;
                if view.index == 4 { Ok((x - at).ln().sum()) } else { Ok(x.sum()) }
            });
            pipeline = pipeline.per_step(per_step);
            fit(FitSettings::default()).step(&mut pipeline).map(|_| ()).unwrap_err()
        };
        let FitError::View { view: 4, error } = refused(6, 0.0) else { panic!("no view") };
        let FitError::NotFinite { quantity: Quantity::Loss, origin: Some(origin), .. } = *error
        else {
            panic!("{error}")
        };
        assert!(matches!(*origin, Origin::Output { operation: "ln", .. }), "{origin}");
        assert!(
            refused(6, 0.0)
                .to_string()
                .starts_with("view 4: the loss needs to be finite, got -inf")
        );
        assert_eq!(
            refused(0, 0.0).to_string(),
            "views per step needs from 1 to all views, got 0 of 6"
        );
        assert_eq!(
            refused(7, 0.0).to_string(),
            "views per step needs from 1 to all views, got 7 of 6"
        );

        let mut vector = views(2, |_, _, variables| variables.get("x"));
        let error = fit(FitSettings::default()).step(&mut vector).map(|_| ()).unwrap_err();
        assert!(matches!(error, FitError::Tensor(_)), "{error}");
        let mut none = views(0, |_, _, variables| variables.get("still"));
        let error = fit(FitSettings::default()).step(&mut none).map(|_| ()).unwrap_err();
        assert_eq!(error.to_string(), "views needs at least 1 view, got 0");
    }

    #[cfg(feature = "save")]
    #[test]
    fn a_fit_is_resumed_with_the_views_it_was_saved_with() {
        let pipeline = |per_step, seed| {
            views::<f64, _>(9, |_, _, variables| variables.get("still"))
                .per_step(per_step)
                .seed(seed)
        };
        let mut state = Vec::new();
        pipeline(4, 8).save_state(&mut state);
        assert!(pipeline(4, 8).restore_state(&state).is_ok());
        let error = pipeline(4, 9).restore_state(&state).unwrap_err().to_string();
        let [needed, found] = [9, 8].map(|seed| format!("4 of 9 views per step from seed {seed}"));
        assert_eq!(error, format!("a saved fit needs {needed}, got {found}"));
        assert!(pipeline(3, 8).restore_state(&state).is_err());
        assert!(pipeline(4, 8).restore_state(&state[..20]).is_err());
    }
}
