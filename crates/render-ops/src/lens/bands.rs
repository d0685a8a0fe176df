//! The passes over bands of rows: from surfaces to rungs, blurs, and what is seen; and back.
//!
//! A pass works on all bands at the same time, and each band writes its own memory. A gradient's fragment is of
//! one pixel, so of one band; sums over all pixels are taken in the order of the bands. So the bits are the same
//! for any number of threads.
//!
//! # Backward
//! With `E = (C_bar, A_bar)` of the rungs k and k + 1 at its pixel, blurred, a surface of colour times alpha c,
//! of alpha a, and with the share p of the pixel has with `B = (1 - t) E_k + t E_(k+1)`:
//! `(c, a)_bar = p B`, `p_bar = B . (c, a)`, `s_bar = p (E_(k+1) - E_k) . (c, a) dt/ds`.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::{for_each_item_mut, for_each_two_pieces_mut};

use super::disc::{self, Disc, blur_disc};
use super::front_to_back::{Gaps, Layer, pull_back, see};
use super::hiding::{LinkBar, pull_back_share};
use super::rungs::Rungs;
use super::strips::{Bands, ROWS, Strips};
use super::surfaces::{NONE, Part, Parts, Share, View};
use crate::background::Kind;
use crate::scratch::Workbench;
use crate::size::Size;

/// The part of the image that is shown: without the margin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub(super) size: Size,
    pub(super) margin: usize,
}

impl Frame {
    fn rows(&self, band: usize) -> Range<usize> {
        band * ROWS..((band + 1) * ROWS).min(self.size.height)
    }

    /// The rows and columns that band `band` of what is shown has.
    fn shown(&self, band: usize) -> [Range<usize>; 2] {
        let Size { width, height } = self.size;
        let start = self.margin + band * ROWS;
        [start..(start + ROWS).min(height - self.margin), self.margin..width - self.margin]
    }

    /// The size without the margin.
    pub(super) fn shown_size(&self) -> Size {
        let Size { width, height } = self.size;
        Size { width: width - 2 * self.margin, height: height - 2 * self.margin }
    }
}

/// What a band found, beside its strips.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Told {
    /// Tells on which smooth piece all of it lies.
    pub(super) piece: u64,
}

impl Told {
    fn add(&mut self, piece: u64) {
        self.piece = (self.piece ^ piece).wrapping_mul(0x0100_0000_01b3);
    }
}

/// A band of a picture.
#[derive(Debug, Default)]
pub(super) struct Band<T: Scalar> {
    /// The rungs, and the blurred rungs, where they are seen.
    pub(super) blurred: Strips<T>,
    /// The gradients of the blurred rungs.
    pub(super) told: Told,
}

/// Memory for a band.
#[derive(Debug)]
pub(super) struct Bench<T: Scalar> {
    found: Parts<T::Wide>,
    layers: Vec<Layer<T::Wide>>,
    dots: Vec<T::Wide>,
    seen_bars: Vec<T::Wide>,
    link_bars: Vec<LinkBar<T::Wide>>,
    picture: Vec<T::Wide>,
    disc: disc::Bench<T::Wide>,
}

impl<T: Scalar> Default for Bench<T> {
    fn default() -> Self {
        Self {
            found: Parts::default(),
            layers: Vec::new(),
            dots: Vec::new(),
            seen_bars: Vec::new(),
            link_bars: Vec::new(),
            picture: Vec::new(),
            disc: disc::Bench::default(),
        }
    }
}

/// Calls `visit` for each pixel of some rows with what it shows.
fn for_each_pixel<T: Scalar>(
    view: &View<'_, T>,
    rows: Range<usize>,
    found: &mut Parts<T::Wide>,
    mut visit: impl FnMut(usize, &mut Parts<T::Wide>),
) {
    let boundary = &view.visible.boundary;
    let width = view.visible.size().width;
    let first = rows.start * width;
    let mut next = boundary.pixels.partition_point(|&pixel| (pixel as usize) < first);
    for pixel in first..rows.end * width {
        let mut pieces = None;
        if boundary.pixels.get(next).is_some_and(|&at| at as usize == pixel) {
            pieces = Some(boundary.fragments_of(next));
            next += 1;
        }
        view.find_parts(pixel, pieces, found);
        visit(pixel, found);
    }
}

/// Shares the surfaces among the rungs.
pub(super) fn fill_rungs<T: Scalar>(
    view: &View<'_, T>,
    frame: Frame,
    bands: &mut [Strips<T>],
    told: &mut [Told],
    benches: &Workbench<Bench<T>>,
) {
    let (size, entries) = (frame.size, view.surfaces.channels + 1);
    for_each_two_pieces_mut(bands, told, [1, 1], |band, strips, told| {
        let (strips, told) = (&mut strips[0], &mut told[0]);
        strips.clear();
        *told = Told::default();
        benches.with(|bench| {
            for_each_pixel(view, frame.rows(band), &mut bench.found, |pixel, found| {
                let [row, column] = size.row_and_column(pixel);
                told.add(found.piece);
                for part in &found.parts {
                    let (color, alpha) = view.color(part.surface, pixel);
                    for (rung, weight) in rungs_of(part) {
                        let weight = weight * part.share;
                        let strip = strips.strip_mut(rung, row, entries, size);
                        let to = strip.pixel_mut(row, column);
                        for (to, from) in to.iter_mut().zip(beside_reference(view, color, alpha)) {
                            *to += T::narrow(weight * from);
                        }
                    }
                }
            });
        });
    });
}

/// What rungs hold of a colour: its difference to the reference of the same alpha; and then the alpha.
fn beside_reference<'a, T: Scalar>(
    view: &View<'a, T>,
    color: &'a [T],
    alpha: T,
) -> impl Iterator<Item = T::Wide> + use<'a, T> {
    let alpha = alpha.widen();
    let pairs = color.iter().zip(view.reference());
    let difference = move |(&color, &of): (&T, &T)| color.widen() - alpha * of.widen();
    pairs.map(difference).chain(std::iter::once(alpha))
}

/// The rungs that a part lies on, with its weights.
fn rungs_of<S: Scalar>(part: &Part<S>) -> impl Iterator<Item = (usize, S)> {
    let place = part.place;
    let all = [(place.rung, S::ONE - place.next), (place.rung + 1, place.next)];
    // In focus there is no slope, either.
    let count = if part.circle.radius == S::ZERO { 1 } else { 2 };
    all.into_iter().take(count)
}

/// A blur of all rungs of `source`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blurs<'a> {
    pub(super) rungs: &'a Rungs,
    pub(super) discs: &'a [Disc],
    pub(super) frame: Frame,
}

impl Blurs<'_> {
    /// Blurs what is within reach of some rows and columns into `target`.
    fn blur<T: Scalar>(
        &self,
        source: &[Strips<T>],
        [rows, columns]: [Range<usize>; 2],
        target: &mut Strips<T>,
        bench: &mut disc::Bench<T::Wide>,
    ) {
        target.clear();
        let size = self.frame.size;
        for rung in 0..self.rungs.count() {
            let disc = &self.discs[self.rungs.steps(rung)];
            if disc.is_vacant() {
                continue;
            }
            let reach = disc.reach();
            // What is mirrored lies no farther away than its mirror.
            let seen = rows.start.saturating_sub(reach)..(rows.end + reach).min(size.height);
            let mut held: Option<[usize; 2]> = None;
            let mut entries = 0;
            for band in &source[seen.start / ROWS..(seen.end - 1) / ROWS + 1] {
                let Some(strip) = band.get(rung).filter(|strip| !strip.held.is_empty()) else {
                    continue;
                };
                entries = strip.entries;
                let [first, end] = held.unwrap_or([strip.held.start, strip.held.end]);
                held = Some([first.min(strip.held.start), end.max(strip.held.end)]);
            }
            let Some([first, end]) = held else { continue };
            let first = first.saturating_sub(reach).max(columns.start);
            let end = (end + reach).min(columns.end);
            if first < end {
                let strip = target.push();
                strip.rung = rung;
                strip.entries = entries;
                (strip.rows, strip.columns) = (rows.clone(), first..end);
                let source = Bands { strips: source, first: 0 };
                blur_disc(source, rung, size, disc, strip, bench);
            }
        }
    }

    /// Blurs the rungs, and writes what is seen of them to `out`, the picture without its margin.
    pub(super) fn see<T: Scalar>(
        &self,
        source: &[Strips<T>],
        gaps: &Gaps,
        reference: &[T],
        bands: &mut [Band<T>],
        benches: &Workbench<Bench<T>>,
        out: &mut [T],
    ) {
        let row = out.len() / self.frame.shown_size().height;
        for_each_two_pieces_mut(bands, out, [1, ROWS * row], |band, own, out| {
            let own = &mut own[0];
            own.told = Told::default();
            benches.with(|bench| {
                let shown = self.frame.shown(band);
                self.blur(source, shown.clone(), &mut own.blurred, &mut bench.disc);
                let [rows, columns] = shown;
                let mut pixels = out.chunks_exact_mut(row / columns.len());
                for row in rows {
                    for column in columns.clone() {
                        let out = pixels.next().expect("as many as are shown");
                        let piece = show(&own.blurred, [row, column], gaps, bench);
                        own.told.add(piece);
                        // The background, where nothing at all is seen.
                        out.copy_from_slice(reference);
                        for (out, &sum) in out.iter_mut().zip(&bench.picture) {
                            *out = T::narrow(out.widen() + sum);
                        }
                    }
                }
            });
        });
    }

    /// The gradients of the blurred rungs, of the picture's gradients `out_bar`.
    pub(super) fn pull_back_seen<T: Scalar>(
        &self,
        bands: &[Band<T>],
        gaps: &Gaps,
        out_bar: &[T],
        bars: &mut [Strips<T>],
        benches: &Workbench<Bench<T>>,
    ) {
        let row_of = out_bar.len() / self.frame.shown_size().height;
        let margin = self.frame.margin;
        for_each_item_mut(bars, |band, bars| {
            bars.clear();
            let blurred = &bands[band].blurred;
            for from in blurred.iter() {
                let to = bars.push();
                (to.rung, to.entries) = (from.rung, from.entries);
                (to.rows, to.columns) = (from.rows.clone(), from.columns.clone());
                to.held = from.held.clone();
                to.values.clear();
                to.values.resize(from.values.len(), T::ZERO);
            }
            let [rows, columns] = self.frame.shown(band);
            let channels = row_of / columns.len();
            benches.with(|bench| {
                for row in rows {
                    let out_bar = &out_bar[(row - margin) * row_of..][..row_of];
                    for (column, bar) in columns.clone().zip(out_bar.chunks_exact(channels)) {
                        show(blurred, [row, column], gaps, bench);
                        hide(blurred, [row, column], gaps, bar, bars, bench);
                    }
                }
            });
        });
    }

    /// The gradients of the surfaces in a band.
    pub(super) fn pull_back_rungs<T: Scalar>(
        &self,
        view: &View<'_, T>,
        source: &Strips<T>,
        bars: &[Strips<T>],
        band: usize,
        found: &mut BandBars<T>,
        bench: &mut Bench<T>,
    ) {
        let rows = self.frame.rows(band);
        found.clear(view.surfaces.channels, rows.len() * self.frame.size.width, view.kind);
        found.at_rungs.clear();
        // Only where a surface asks.
        for strip in source.iter().filter(|strip| !strip.held.is_empty()) {
            let disc = &self.discs[self.rungs.steps(strip.rung)];
            let to = found.at_rungs.push();
            (to.rung, to.entries) = (strip.rung, strip.entries);
            (to.rows, to.columns) = (rows.clone(), strip.held.clone());
            let bars = Bands { strips: bars, first: self.frame.margin };
            blur_disc(bars, strip.rung, self.frame.size, disc, to, &mut bench.disc);
        }
        let Bench { found: parts, link_bars, .. } = bench;
        for_each_pixel(view, rows, parts, |pixel, parts| {
            found.add_pixel(view, self.frame.size, pixel, parts, link_bars);
        });
    }
}

/// Puts the rungs at a pixel together, in `bench.picture`, beside the reference; returns a number that tells on which smooth piece it
/// lies.
fn show<T: Scalar>(
    blurred: &Strips<T>,
    [row, column]: [usize; 2],
    gaps: &Gaps,
    bench: &mut Bench<T>,
) -> u64 {
    let Bench { layers, picture, .. } = bench;
    layers.clear();
    let mut channels = 0;
    for (at, strip) in blurred.iter().enumerate() {
        channels = strip.entries - 1;
        let Some(values) = strip.pixel(row, column) else { continue };
        let alpha = values[channels].widen();
        if alpha > T::Wide::ZERO {
            layers.push(Layer::new(strip.rung, at, alpha));
        }
    }
    let (total, piece) = see(layers, gaps);
    picture.clear();
    picture.resize(channels, T::Wide::ZERO);
    for layer in &*layers {
        let values = blurred.nth(layer.strip).pixel(row, column).expect("it has an alpha");
        for (sum, &value) in picture.iter_mut().zip(values) {
            *sum += layer.share * value.widen();
        }
    }
    if total > T::Wide::ZERO {
        picture.iter_mut().for_each(|sum| *sum = *sum / total);
    }
    piece
}

/// Adds to `bars` the gradients of the blurred rungs at a pixel that was shown last.
fn hide<T: Scalar>(
    blurred: &Strips<T>,
    [row, column]: [usize; 2],
    gaps: &Gaps,
    out_bar: &[T],
    bars: &mut Strips<T>,
    bench: &mut Bench<T>,
) {
    let Bench { layers, picture, dots, seen_bars, .. } = bench;
    let total: T::Wide = layers.iter().map(|layer| layer.seen).sum();
    if total <= T::Wide::ZERO {
        return;
    }
    let channels = picture.len();
    let dot = |values: &[T]| -> T::Wide {
        let terms = values.iter().zip(out_bar).map(|(&value, &bar)| value.widen() * bar.widen());
        terms.sum::<T::Wide>() / total
    };
    dots.clear();
    dots.extend(layers.iter().map(|layer| {
        dot(&blurred.nth(layer.strip).pixel(row, column).expect("it has an alpha")[..channels])
    }));
    let terms = picture.iter().zip(out_bar).map(|(&value, &bar)| value * bar.widen());
    let total_bar = -(terms.sum::<T::Wide>() / total);
    pull_back(layers, gaps, dots, total_bar, seen_bars, |k, bar| {
        let to = bars.nth_mut(layers[k].strip).pixel_mut(row, column);
        to[channels] = T::narrow(bar);
        for (to, &bar) in to.iter_mut().zip(out_bar) {
            *to = T::narrow(layers[k].share * bar.widen() / total);
        }
    });
}

/// Gradients of the surfaces in a band.
#[derive(Debug)]
pub(super) struct BandBars<T: Scalar> {
    at_rungs: Strips<T>,
    /// The surfaces, and for each its gradients: of the colour, of the alpha, of the distance.
    pub(super) surfaces: Vec<u32>,
    pub(super) bars: Vec<T::Wide>,
    /// Visible pieces, and the gradients of their weights.
    pub(super) weights: Vec<(u32, T::Wide)>,
    /// Of aperture and focus.
    pub(super) optics: [T::Wide; 2],
    /// Of a background colour, or of the background of the band's pixels.
    pub(super) background: Vec<T::Wide>,
    /// E at rungs k and k + 1.
    beside: [Vec<T::Wide>; 2],
}

impl<T: Scalar> Default for BandBars<T> {
    fn default() -> Self {
        Self {
            at_rungs: Strips::default(),
            surfaces: Vec::new(),
            bars: Vec::new(),
            weights: Vec::new(),
            optics: [T::Wide::ZERO; 2],
            background: Vec::new(),
            beside: [Vec::new(), Vec::new()],
        }
    }
}

impl<T: Scalar> BandBars<T> {
    fn clear(&mut self, channels: usize, pixels: usize, kind: Kind) {
        self.surfaces.clear();
        self.bars.clear();
        self.weights.clear();
        self.optics = [T::Wide::ZERO; 2];
        self.background.clear();
        let count = if kind == Kind::Image { pixels } else { 1 };
        self.background.resize(count * channels, T::Wide::ZERO);
    }

    /// Adds the gradients of what a pixel shows.
    fn add_pixel(
        &mut self,
        view: &View<'_, T>,
        size: Size,
        pixel: usize,
        parts: &Parts<T::Wide>,
        link_bars: &mut Vec<LinkBar<T::Wide>>,
    ) {
        let [row, column] = size.row_and_column(pixel);
        let zero = T::Wide::ZERO;
        link_bars.clear();
        link_bars.resize(parts.chain.len(), LinkBar { alpha: zero, radius: zero });
        for part in &parts.parts {
            let (color, alpha) = view.color(part.surface, pixel);
            for (beside, rung) in self.beside.iter_mut().zip(part.place.rung..) {
                beside.clear();
                match self.at_rungs.get(rung).and_then(|strip| strip.pixel(row, column)) {
                    Some(values) => beside.extend(values.iter().map(|value| value.widen())),
                    None => beside.resize(color.len() + 1, zero),
                }
            }
            let (mut share_bar, mut next_bar) = (zero, zero);
            let [own, next] = &mut self.beside;
            let values = beside_reference(view, color, alpha);
            for ((own, &next), value) in own.iter_mut().zip(&*next).zip(values) {
                let step = next - *own;
                *own += part.place.next * step;
                share_bar += *own * value;
                next_bar += step * value;
            }
            if let Some((alpha_bar, color_bars)) = own.split_last_mut() {
                let terms = color_bars.iter().zip(view.reference());
                *alpha_bar -= terms.map(|(&bar, &of)| bar * of.widen()).sum();
            }
            let radius_bar = part.share * next_bar * part.place.slope;
            self.add_surface(view, part.surface, [row, column], part.share, radius_bar);
            match part.kind {
                Share::Whole => {}
                Share::Piece(piece) => self.weights.push((piece, share_bar)),
                Share::Left => self.take_from_pieces(parts, share_bar),
                Share::Beside => {
                    self.add_beside(view, pixel, parts, share_bar, &mut link_bars[0]);
                }
                Share::Behind(last) => {
                    pull_back_share(&parts.chain[..=last as usize], share_bar, link_bars);
                }
            }
        }
        for (link, bar) in parts.chain.iter().zip(&*link_bars) {
            if !bar.alpha.is_same(zero) || !bar.radius.is_same(zero) {
                self.add_hiding(view, link.surface, [row, column], *bar);
            }
        }
    }

    /// Adds the gradients of how much a surface hides.
    fn add_hiding(
        &mut self,
        view: &View<'_, T>,
        surface: u32,
        place: [usize; 2],
        bar: LinkBar<T::Wide>,
    ) {
        let beside = &mut self.beside[0];
        beside.clear();
        beside.resize(view.surfaces.channels, T::Wide::ZERO);
        beside.push(bar.alpha);
        self.add_surface(view, surface, place, T::Wide::ONE, bar.radius);
    }

    /// Adds the gradients of the share of what pieces hide.
    fn add_beside(
        &mut self,
        view: &View<'_, T>,
        pixel: usize,
        parts: &Parts<T::Wide>,
        share_bar: T::Wide,
        first_bar: &mut LinkBar<T::Wide>,
    ) {
        let place = view.visible.size().row_and_column(pixel);
        for part in &parts.parts {
            let Some((piece, behind)) = view.behind(part, parts.chain[0], pixel) else { continue };
            self.weights.push((piece, share_bar * behind.share));
            let bar = share_bar * part.share;
            let [radius, first_radius] = behind.by_radii.map(|slope| bar * slope);
            first_bar.radius += first_radius;
            self.add_hiding(
                view,
                part.surface,
                place,
                LinkBar { alpha: bar * behind.by_alpha, radius },
            );
        }
    }

    /// What pieces leave is less by their weights.
    fn take_from_pieces(&mut self, parts: &Parts<T::Wide>, share_bar: T::Wide) {
        for part in &parts.parts {
            if let Share::Piece(piece) = part.kind {
                self.weights.push((piece, -share_bar));
            }
        }
    }

    /// Adds the gradients `share` times those in `beside[0]`, of a surface's colour and alpha, and of its radius.
    fn add_surface(
        &mut self,
        view: &View<'_, T>,
        surface: u32,
        [row, column]: [usize; 2],
        share: T::Wide,
        radius_bar: T::Wide,
    ) {
        let circle = view.circle(surface);
        self.optics[0] += radius_bar * circle.by_aperture;
        self.optics[1] += radius_bar * circle.by_focus;
        let bars = &self.beside[0];
        if surface == NONE {
            let channels = bars.len() - 1;
            let pixel = row % ROWS * view.visible.size().width + column;
            let to = &mut self.background[view.kind.entry(channels, pixel)..][..channels];
            to.iter_mut().zip(bars).for_each(|(to, &bar)| *to += share * bar);
            return;
        }
        self.surfaces.push(surface);
        self.bars.extend(bars.iter().map(|&bar| share * bar));
        self.bars.push(radius_bar * circle.by_distance);
    }
}

/// The bytes of strips, for reports.
pub(super) fn bytes_of<T: Scalar>(bands: &[Strips<T>]) -> usize {
    bands.iter().map(Strips::bytes).sum()
}
