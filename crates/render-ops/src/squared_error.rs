//! The squared error of a picture against a reference image.
//!
//! # Forward
//! `L = sum_p |x_p - r_p|^2` over the pixels p of the picture, plus the background's squared error at
//! all others, which the [`PixelLoss`] knows. Squares and sums in [`Scalar::Wide`].
//!
//! # Backward
//! `x_bar_p = 2 (x_p - r_p) L_bar`. Where `L_bar` is 1, as in a fit, that is what the forward pass left,
//! and nothing is computed. Its memory becomes the gradient then; a second backward pass computes it anew.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::parallel::join;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, TensorError, Var};

use crate::coverage::Coverage;
use crate::fetch::{fetch_all, is_large_image};
use crate::picture::Picture;
use crate::pixel_loss::PixelLoss;

impl<'t, T: Scalar> Picture<'t, T> {
    /// The squared error of the picture with `values: [P, C]` in the place of its own, and of the background beside
    /// it, against the reference of `loss`, which is one of squared errors before this background; returns `[]`.
    #[inline(never)]
    pub(crate) fn squared_error(
        &self,
        values: Var<'t, T>,
        loss: &PixelLoss<T>,
    ) -> Result<Var<'t, T>, TensorError> {
        let op = SquaredError {
            coverage: Arc::clone(&self.coverage),
            blended: self.blended.clone(),
            loss: loss.clone(),
        };
        let tape = values.tape();
        tape.leave_out("squared_error", "pixels of the background: summed with the reference");
        tape.apply(op, &[values])
    }
}

/// Input: values `[P, C]`. Output: `[]`.
struct SquaredError<T: Scalar> {
    coverage: Arc<Coverage>,
    blended: Option<Arc<Vec<u32>>>,
    loss: PixelLoss<T>,
}

/// Entries that are copied at once.
const AT_ONCE: usize = 24;

/// Copies the first `length` entries. What it writes after them means nothing: most runs are
/// short, and one or two blocks of entries take less time than as many as there are.
#[inline(always)]
fn copy_run<T: Scalar>(length: usize, source: &[T], target: &mut [T]) {
    let mut done = 0;
    for _ in 0..2 {
        if done < length
            && let (Some(target), Some(source)) = (
                target[done..].first_chunk_mut::<AT_ONCE>(),
                source[done..].first_chunk::<AT_ONCE>(),
            )
        {
            *target = *source;
            done += AT_ONCE;
        }
    }
    if done < length {
        target[done..length].copy_from_slice(&source[done..length]);
    }
}

/// Reads the rows of a band of the reference image in their order, which a processor reads ahead. Face by face, each of
/// many short runs would be waited for.
#[inline(always)]
fn fetch_reference<T: Scalar>(
    coverage: &Coverage,
    slots: Range<usize>,
    reference: &[T],
    channels: usize,
) {
    let runs = &coverage.centers;
    let are_short =
        || runs.fragments_of(slots.clone()).len() <= SHORT * runs.in_slots(slots.clone()).len();
    if !is_large_image(reference) || !are_short() {
        return;
    }
    for pixels in coverage.pixels_by_row(slots) {
        fetch_all(&reference[pixels.start * channels..pixels.end * channels], |&entry| entry);
    }
}

/// Pixels of a short run, on average. Of longer ones a processor reads ahead by itself.
const SHORT: usize = 16;

/// Partial sums, so that additions overlap.
const PARTS: usize = 16;

/// Writes `2 (x - r)` where r was; returns the sum of the squares of `x - r`.
#[inline(always)]
fn subtract<T: Scalar>(x: &[T], r: &mut [T]) -> T::Wide {
    let (mut parts, two) = ([T::Wide::ZERO; PARTS], T::from_f64(2.0));
    let ((x, x_rest), (r, r_rest)) = (x.as_chunks::<PARTS>(), r.as_chunks_mut::<PARTS>());
    for (x, r) in x.iter().zip(r) {
        // Each step has a loop of its own: the compiler takes vectors of sums apart otherwise.
        let (mut differences, mut wide) = ([T::ZERO; PARTS], [T::Wide::ZERO; PARTS]);
        for part in 0..PARTS {
            differences[part] = x[part] - r[part];
        }
        for part in 0..PARTS {
            wide[part] = differences[part].widen();
        }
        for part in 0..PARTS {
            parts[part] += wide[part] * wide[part];
        }
        for part in 0..PARTS {
            r[part] = differences[part] * two;
        }
    }
    for (part, (&x, r)) in parts.iter_mut().zip(x_rest.iter().zip(r_rest)) {
        let difference = x - *r;
        *part += difference.widen() * difference.widen();
        *r = difference * two;
    }
    parts.into_iter().sum()
}

impl<T: Scalar> SquaredError<T> {
    /// The sum of the squared errors of all pixels; writes `2 (x - r): [P, C]`. What is seen of the background is listed
    /// in `gaps`.
    fn total(&self, x: &[T], slopes: &mut [T], gaps: &mut Vec<T::Wide>) -> T::Wide {
        gaps.clear();
        let list_gaps =
            || self.coverage.for_each_gap(self.blended(), |gap| gaps.push(self.loss.behind(gap)));
        let are_shared = self.coverage.centers.is_shared();
        let (total, ()) = join(are_shared, || self.compare(x, slopes), list_gaps);
        gaps.iter().fold(total, |total, &gap| total + gap)
    }

    /// Writes `2 (x - r): [P, C]`; returns the sum of the squared errors of the picture's pixels.
    fn compare(&self, x: &[T], slopes: &mut [T]) -> T::Wide {
        let reference = self.loss.reference();
        let (coverage, channels) = (&*self.coverage, reference.shape()[2]);
        let reference = reference.data();
        let runs = &coverage.centers;
        let (covered, blended) = slopes.split_at_mut(coverage.centers() * channels);
        let (x_covered, x_blended) = x.split_at(covered.len());
        let square = |difference: &T| difference.widen() * difference.widen();
        let two = T::from_f64(2.0);
        let mut total = T::Wide::ZERO;
        let work = |slots: Range<usize>, first: usize, covered: &mut [T]| {
            let x = &x_covered[first * channels..][..covered.len()];
            crate::dispatch::dispatch::<T, _>(
                #[inline(always)]
                || {
                    fetch_reference(coverage, slots.clone(), reference, channels);
                    let mut start = 0;
                    for run in runs.in_slots(slots) {
                        let length = run.length as usize * channels;
                        let reference = &reference[run.pixel as usize * channels..];
                        copy_run(length, reference, &mut covered[start..]);
                        start += length;
                    }
                    subtract(x, covered)
                },
            )
        };
        runs.merge_bands_mut(channels, covered, work, |band| total += band);
        let rows = blended.chunks_exact_mut(channels).zip(x_blended.chunks_exact(channels));
        for (&pixel, (row, x)) in self.blended().iter().zip(rows) {
            let reference = &reference[pixel as usize * channels..][..channels];
            row.iter_mut().zip(x.iter().zip(reference)).for_each(|(row, (&x, &r))| *row = x - r);
            total += row.iter().map(square).sum();
            row.iter_mut().for_each(|difference| *difference *= two);
        }
        total
    }

    fn blended(&self) -> &[u32] {
        self.blended.as_deref().map_or(&[], Vec::as_slice)
    }
}

/// What is kept of a forward pass, and memory.
#[derive(Debug, Default)]
struct SavedSlopes<T: Scalar> {
    /// Twice the differences, `2 (x - r): [P, C]`; nothing where they were given to a gradient.
    slopes: Option<Vec<T>>,
    /// Memory: the errors of gaps between the picture's pixels.
    gaps: Vec<T::Wide>,
}

impl<T: Scalar> Op<T> for SquaredError<T> {
    type Saved = SavedSlopes<T>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "squared_error"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        SavedSlopes { slopes, gaps }: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        let x = inputs.data(0);
        let slopes = slopes.get_or_insert_with(|| outputs.buffer(x.len()));
        if slopes.len() != x.len() {
            slopes.resize(x.len(), T::ZERO);
        }
        let total = self.total(x, slopes, gaps);
        outputs.push([])[0] = T::narrow(total);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        SavedSlopes { slopes, .. }: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let slopes_now = slopes.take().unwrap_or_else(|| {
            let x = kept.input(0);
            let mut slopes_now = gradients.buffer(x.len());
            self.compare(x, &mut slopes_now);
            slopes_now
        });
        let factor = kept.only_upstream()[0];
        if factor.is_same(T::ONE) {
            return gradients.give(0, slopes_now);
        }
        if let Some(x_bar) = gradients.get(0) {
            x_bar.add_zipped([&slopes_now], |[slope]| factor * slope);
        }
        *slopes = Some(slopes_now);
    }

    fn saved_bytes(&self, SavedSlopes { slopes, .. }: &Self::Saved) -> usize {
        size_of_val(slopes.as_deref().unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_copied_whole_whatever_lies_behind_it() {
        for length in 0..=60 {
            for more in
                [[0, 0], [0, 100], [100, 0], [1, 23], [23, 24], [24, 23], [47, 48], [100, 100]]
            {
                let [source_length, target_length] = more.map(|more| length + more);
                let source: Vec<f32> = (0..source_length).map(|k| 1.0 + k as f32).collect();
                let mut target = vec![0.0; target_length];
                copy_run(length, &source, &mut target);
                assert_eq!(target[..length], source[..length], "{length} {more:?}");
            }
        }
    }
}
