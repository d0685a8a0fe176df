//! Each pixel through an iris, as a mixture of two blurs of the whole image.
//!
//! # Forward
//! A pixel's circle has the signed radius s: twice its sigma, and below 0 in front of the focus. It lies between two
//! rungs (`defocus/rungs`), blurs D through the iris: `b_i = (1 - t_i) (D_k c)_i + t_i (D_(k+1) c)_i`, where k and t
//! follow from s. So each pixel's weights have the variance of a disc of radius s.
//!
//! # Backward
//! `c_bar = sum_k D_k^T (w_k b_bar)`, w_k the pixels' shares of rung k, 1 - t or t; and
//! `db_i/ds_i = (D_(k+1) c - D_k c)_i dt_i/ds_i`, which the forward pass keeps.
//!
//! # Order of work
//! Forward, a band of rows mixes what its pixels lie between. Backward, rungs come one after another, each in two
//! passes over all bands: so only the gradients of one rung are held.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::{for_each_item_mut, for_each_piece_mut, for_each_two_pieces_mut};

use crate::defocus::{
    Bands, Blur, Blurs, Iris, Memory, Part, Position, ROWS, Strips, halved, mean_weight,
};
use crate::scratch::Workbench;
use crate::size::Size;

/// Where all pixels lie between rungs, and what the rungs need.
#[derive(Debug, Default)]
pub(super) struct Mixtures<T: Scalar> {
    blurs: Blurs,
    bands: Vec<Band<T::Wide>>,
    /// The image by band: one strip for each number of halvings, by which it is found in the place of a rung.
    image: Vec<Strips<T::Wide>>,
    /// Memory of a backward pass: the gradients of a rung by band.
    bars: Vec<Strips<T::Wide>>,
    benches: Workbench<Bench<T::Wide>>,
}

/// A band of the image.
#[derive(Debug, Default)]
struct Band<S> {
    positions: Vec<Position<S>>,
    /// Per rung the columns between which pixels lie beside it.
    columns: Vec<Range<usize>>,
}

/// Memory for the work on a band.
#[derive(Debug, Default)]
struct Bench<S> {
    blur: Memory<S>,
    /// A rung's shares of pixels, and their derivatives by the radius.
    shares: [Vec<S>; 2],
    blurred: Vec<S>,
    /// The result and its slopes, channel by channel.
    sums: [Vec<S>; 2],
}

/// The share that a pixel has of a rung, and its derivative by the radius.
fn share<S: Scalar>(position: &Position<S>, rung: usize) -> [S; 2] {
    match rung.wrapping_sub(position.rung) {
        0 => [S::ONE - position.next, -position.slope],
        1 => [position.next, position.slope],
        _ => [S::ZERO; 2],
    }
}

impl<S: Scalar> Band<S> {
    /// Finds where pixels of signed radii lie, in rows of `width`.
    fn locate<T: Scalar<Wide = S>>(&mut self, radii: &[T], width: usize, blurs: &Blurs) {
        let Self { positions, columns } = self;
        positions.clear();
        positions.extend(radii.iter().map(|radius| blurs.rungs.locate(radius.widen())));
        columns.clear();
        columns.resize(blurs.rungs.count(), 0..0);
        for (pixel, position) in positions.iter().enumerate() {
            let column = pixel % width;
            for rung in [position.rung, position.rung + 1] {
                if share(position, rung) != [S::ZERO; 2] {
                    let range = &mut columns[rung];
                    let is_first = range.start == range.end;
                    let first = if is_first { column } else { range.start.min(column) };
                    *range = first..range.end.max(column + 1);
                }
            }
        }
    }

    /// Fills in the shares of a rung in some columns.
    fn share_rung(&self, rung: usize, width: usize, columns: &Range<usize>, to: &mut [Vec<S>; 2]) {
        to.iter_mut().for_each(Vec::clear);
        for row in self.positions.chunks_exact(width) {
            for position in &row[columns.clone()] {
                let [share, slope] = share(position, rung);
                to[0].push(share);
                to[1].push(slope);
            }
        }
    }
}

/// The rows of a band.
fn rows(band: usize, size: Size) -> Range<usize> {
    band * ROWS..((band + 1) * ROWS).min(size.height)
}

/// A band and its columns, of an image that is halved so often.
fn small_band(band: usize, size: Size, halvings: usize) -> Part {
    let rows = rows(band, size);
    let columns = 0..halved(size, halvings).width;
    [rows.start >> halvings..rows.end.div_ceil(1 << halvings), columns]
}

/// The size of an image `[H, W, C]`, and its channels.
fn extents(shape: &[usize]) -> (Size, usize) {
    (Size { height: shape[0], width: shape[1] }, shape[2])
}

impl<T: Scalar> Mixtures<T> {
    /// The image `[H, W, C]` through an iris, with each pixel's circle of a signed radius in `radii`, of at most
    /// `largest`; and, unless it is empty, the derivative of each entry of `out` with respect to that radius.
    pub(super) fn blur(
        &mut self,
        [image, radii]: [&[T]; 2],
        shape: &[usize],
        (iris, largest): (Iris, f64),
        out: &mut [T],
        slopes: &mut [T],
    ) {
        let (size, channels) = extents(shape);
        self.blurs.reach(largest, iris);
        let Self { blurs, bands, .. } = self;
        bands.resize_with(size.height.div_ceil(ROWS), Band::default);
        for_each_item_mut(bands, |band, own| {
            let rows = rows(band, size);
            let radii = &radii[rows.start * size.width..rows.end * size.width];
            own.locate(radii, size.width, blurs);
        });
        for rung in 0..blurs.rungs.count() {
            if bands.iter().any(|band| !band.columns[rung].is_empty()) {
                blurs.use_rung(rung);
            }
        }
        self.halve(image, size, channels);
        let piece = ROWS * size.width * channels;
        for_each_two_pieces_mut(out, slopes, [piece; 2], |band, out, slopes| {
            self.benches.with(|bench| self.mix(band, size, bench, out, slopes));
        });
    }

    /// The image at the sizes that blurs work at.
    fn halve(&mut self, image: &[T], size: Size, channels: usize) {
        let Self { blurs, image: strips, bands, .. } = self;
        let is_used = |rung: &usize| bands.iter().any(|band| !band.columns[*rung].is_empty());
        let used = (0..blurs.rungs.count()).filter(is_used);
        let most = used.map(|rung| blurs.halvings[rung]).max().unwrap_or(0);
        strips.resize_with(bands.len(), Strips::default);
        for_each_item_mut(strips, |band, strips| {
            strips.clear();
            for halvings in 0..=most {
                let strip = strips.push(halvings, channels, small_band(band, size, halvings));
                strip.values.fill(T::Wide::ZERO);
                let plane = strip.plane();
                for row in rows(band, size) {
                    for column in 0..size.width {
                        let weight = mean_weight(size, halvings, [row, column]);
                        let weight = T::Wide::from_f64(weight);
                        let mut offset = strip.offset(row >> halvings, column >> halvings);
                        for entry in &image[(row * size.width + column) * channels..][..channels] {
                            strip.values[offset] += weight * entry.widen();
                            offset += plane;
                        }
                    }
                }
            }
        });
    }

    /// A rung's blur of the image, and its adjoint.
    fn rung(&self, rung: usize, size: Size) -> [Blur<'_>; 2] {
        let blurs = self.blurs.blur(rung, size).expect("a rung that pixels lie beside is used");
        blurs.map(|blur| Blur { rung: blur.halvings, ..blur })
    }

    /// A band of the result.
    fn mix(
        &self,
        band: usize,
        size: Size,
        bench: &mut Bench<T::Wide>,
        out: &mut [T],
        slopes: &mut [T],
    ) {
        let Bench { blur: memory, shares, blurred, sums } = bench;
        let (own, rows) = (&self.bands[band], rows(band, size));
        let (width, pixels) = (size.width, own.positions.len());
        let lengths = [out.len(), slopes.len()];
        for (sums, length) in sums.iter_mut().zip(lengths) {
            sums.clear();
            sums.resize(length, T::Wide::ZERO);
        }
        let source = Bands { bands: &self.image, first: 0 };
        for (rung, columns) in own.columns.iter().enumerate().filter(|(_, range)| !range.is_empty())
        {
            let [blur, _] = self.rung(rung, size);
            own.share_rung(rung, width, columns, shares);
            blurred.resize(shares[0].len(), T::Wide::ZERO);
            for channel in 0..out.len() / pixels {
                let part = [rows.clone(), columns.clone()];
                blur.apply(source, channel, &part, memory, blurred);
                for (sums, shares) in sums.iter_mut().zip(&*shares).filter(|(s, _)| !s.is_empty()) {
                    let to = sums[channel * pixels..][..pixels].chunks_exact_mut(width);
                    let from = blurred.chunks_exact(columns.len());
                    for (to, (from, shares)) in to.zip(from.zip(shares.chunks(columns.len()))) {
                        let to = &mut to[columns.clone()];
                        for ((to, &from), &share) in to.iter_mut().zip(from).zip(shares) {
                            *to += share * from;
                        }
                    }
                }
            }
        }
        let channels = out.len() / pixels;
        for (to, sums) in [out, slopes].into_iter().zip(&*sums) {
            for (pixel, to) in to.chunks_exact_mut(channels).enumerate() {
                for (channel, to) in to.iter_mut().enumerate() {
                    *to = T::narrow(sums[channel * pixels + pixel]);
                }
            }
        }
    }

    /// Adds to `image_bar` what the gradients `b_bar` of the last result say of its image.
    pub(super) fn blur_adjoint(&mut self, b_bar: &[T], shape: &[usize], image_bar: &mut [T]) {
        let (size, channels) = extents(shape);
        let mut bars = std::mem::take(&mut self.bars);
        bars.resize_with(self.bands.len(), Strips::default);
        let row = size.width * channels;
        for rung in 0..self.blurs.rungs.count() {
            if self.bands.iter().all(|band| band.columns[rung].is_empty()) {
                continue;
            }
            for_each_item_mut(&mut bars, |band, bars| {
                bars.clear();
                let b_bar = &b_bar[band * ROWS * row..];
                self.benches.with(|bench| self.pull_back(rung, band, shape, b_bar, bench, bars));
            });
            for_each_piece_mut(image_bar, ROWS * row, |band, image_bar| {
                self.benches.with(|bench| {
                    self.add_bars(rung, band, shape, &bars, bench, image_bar);
                });
            });
        }
        self.bars = bars;
    }

    /// The gradients of a rung at its own size, of a band.
    fn pull_back(
        &self,
        rung: usize,
        band: usize,
        shape: &[usize],
        b_bar: &[T],
        bench: &mut Bench<T::Wide>,
        bars: &mut Strips<T::Wide>,
    ) {
        let (size, channels) = extents(shape);
        let own = &self.bands[band];
        let columns = &own.columns[rung];
        if columns.is_empty() {
            return;
        }
        let Bench { blur: memory, shares, blurred: weighted, .. } = bench;
        own.share_rung(rung, size.width, columns, shares);
        let [blur, _] = self.rung(rung, size);
        let part = [rows(band, size), columns.clone()];
        let strip = bars.push(blur.rung, channels, blur.small_part(&part));
        let plane = strip.plane();
        for (channel, to) in strip.values.chunks_exact_mut(plane).enumerate() {
            weighted.clear();
            for (row, shares) in shares[0].chunks_exact(columns.len()).enumerate() {
                let start = (row * size.width + columns.start) * channels + channel;
                let bars = b_bar[start..].iter().step_by(channels);
                weighted.extend(shares.iter().zip(bars).map(|(&share, bar)| share * bar.widen()));
            }
            blur.pull_back_size(weighted, &part, memory, to);
        }
    }

    /// Adds the gradients of a rung to those of a band of the image.
    fn add_bars(
        &self,
        rung: usize,
        band: usize,
        shape: &[usize],
        bars: &[Strips<T::Wide>],
        bench: &mut Bench<T::Wide>,
        image_bar: &mut [T],
    ) {
        let (size, channels) = extents(shape);
        let [_, adjoint] = self.rung(rung, size);
        let (bars, halvings) = (Bands { bands: bars, first: 0 }, adjoint.halvings);
        let part = small_band(band, size, halvings);
        if adjoint.is_out_of_sight(bars, &part[0]) {
            return;
        }
        let Bench { blur: memory, blurred, .. } = bench;
        let width = part[1].len();
        blurred.resize(part[0].len() * width, T::Wide::ZERO);
        for channel in 0..channels {
            adjoint.convolve(bars, channel, &part, memory, blurred);
            for (k, to) in image_bar.iter_mut().skip(channel).step_by(channels).enumerate() {
                let [row, column] = [k / size.width, k % size.width];
                let weight = mean_weight(size, halvings, [band * ROWS + row, column]);
                let from = blurred[(row >> halvings) * width + (column >> halvings)];
                *to += T::narrow(T::Wide::from_f64(weight) * from);
            }
        }
    }

    /// Memory that is kept, in bytes.
    pub(super) fn bytes(&self) -> usize {
        let positions = self.bands.iter().map(|band| size_of_val(&band.positions[..]));
        positions.chain(self.image.iter().chain(&self.bars).map(Strips::bytes)).sum()
    }
}
