//! Rows of the image that a picture is, and the gradients of a picture's values from such rows.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::for_each_piece_mut;

use crate::background::Kind;
use crate::coverage::Coverage;
use crate::runs::rows_per_band;

/// Where the values of a picture `[P, C]` are in its image `[H, W, C]`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PictureRows<'a> {
    pub(crate) coverage: &'a Coverage,
    /// The blended pixels, in order.
    pub(crate) blended: &'a [u32],
    pub(crate) channels: usize,
}

impl PictureRows<'_> {
    /// Writes the rows of the image from row `first` on, before a background of one colour.
    pub(crate) fn fill<T: Scalar>(&self, values: &[T], color: &[T], first: usize, image: &mut [T]) {
        let (size, channels) = (self.coverage.size(), self.channels);
        let row_length = size.width * channels;
        let at_once = rows_per_band(size);
        for_each_piece_mut(image, at_once * row_length, |piece, image| {
            let rows = first + piece * at_once..first + piece * at_once + image.len() / row_length;
            let before = rows.start * size.width;
            Kind::Color.fill(image, color, channels, before);
            for run in rows.clone().flat_map(|row| self.coverage.runs_in_row(row)) {
                let [pixels, fragments] = [run.pixels(), run.fragments()];
                let image = &mut image[(pixels.start - before) * channels..];
                let values = &values[fragments.start * channels..fragments.end * channels];
                image[..values.len()].copy_from_slice(values);
            }
            let blended = self.blended_within(before..rows.end * size.width);
            let values = &values[(self.coverage.centers() + blended.start) * channels..];
            for (&pixel, value) in self.blended[blended].iter().zip(values.chunks_exact(channels)) {
                let start = (pixel as usize - before) * channels;
                image[start..start + channels].copy_from_slice(value);
            }
        });
    }

    /// Adds the gradients of the image's `rows` to those of the picture's values. The rows are whole
    /// bands.
    pub(crate) fn pull_back<T: Scalar>(
        &self,
        image_bar: &[T],
        rows: Range<usize>,
        values_bar: &mut [T],
    ) {
        let Self { coverage, channels, .. } = *self;
        let size = coverage.size();
        let per_band = rows_per_band(size);
        debug_assert!(rows.start.is_multiple_of(per_band));
        let pixels = rows.start * size.width..rows.end * size.width;
        let runs = &coverage.centers;
        let (centers_bar, blended_bar) = values_bar.split_at_mut(coverage.centers() * channels);
        let bands = rows.start / per_band..rows.end.div_ceil(per_band).min(runs.bands());
        let work = |slots: Range<usize>, _: usize, entries: &mut [T]| {
            let mut rest = entries;
            for run in runs.in_slots(slots) {
                let (bars, others) = rest.split_at_mut(run.length as usize * channels);
                let upstream = &image_bar[(run.pixel as usize - pixels.start) * channels..];
                bars.iter_mut().zip(upstream).for_each(|(bars, &bar)| *bars += bar);
                rest = others;
            }
        };
        runs.merge_some_bands_mut(bands, channels, centers_bar, work, |()| {});
        let blended = self.blended_within(pixels.clone());
        let blended_bar = blended_bar[blended.start * channels..].chunks_exact_mut(channels);
        for (&pixel, bars) in self.blended[blended].iter().zip(blended_bar) {
            let upstream = &image_bar[(pixel as usize - pixels.start) * channels..];
            bars.iter_mut().zip(upstream).for_each(|(bars, &bar)| *bars += bar);
        }
    }

    /// Which blended pixels lie within `pixels`.
    fn blended_within(&self, pixels: Range<usize>) -> Range<usize> {
        let before = |end: usize| self.blended.partition_point(|&pixel| (pixel as usize) < end);
        before(pixels.start)..before(pixels.end)
    }
}
