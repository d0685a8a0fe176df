//! Gradients of the surfaces in a band: `bands` has the formulas.

use bokashi_core::Scalar;

use super::frame::Frame;
use super::hiding::{LinkBar, Surface, pull_back_share};
use super::spans::Lines;
use super::surfaces::{Layer, Part, Parts, Share, Span, View};
use super::tilt::{self, TiltBar};
use crate::background::Kind;
use crate::defocus::{Blurs, ROWS, Strips, halved, mean_weight};
use crate::runs::Run;

/// Gradients of a layer's fragments at pixel centres, by the pixels of a band.
#[derive(Debug, Default)]
pub(super) struct LayerBars<S> {
    /// Whether there are any; the lists are empty before.
    is_used: bool,
    /// Of the colours, the alphas, the distances, and their slopes.
    lists: [Vec<S>; 4],
}

impl<S: Scalar> LayerBars<S> {
    /// All lists, zeros before their first use.
    #[inline(always)]
    fn used<T>(
        &mut self,
        channels: usize,
        layer: &Layer<'_, T>,
        pixels: usize,
    ) -> &mut [Vec<S>; 4] {
        if !self.is_used {
            self.is_used = true;
            let slopes = if layer.slopes.is_empty() { 0 } else { 2 };
            for (list, width) in self.lists.iter_mut().zip([channels, 1, 1, slopes]) {
                list.clear();
                list.resize(pixels * width, S::ZERO);
            }
        }
        &mut self.lists
    }

    /// The gradients of a run: of colours, alphas, distances or slopes, `width` numbers each.
    pub(super) fn run_bars(
        &self,
        list: usize,
        width: usize,
        first: usize,
        run: &Run,
    ) -> Option<&[S]> {
        let pixels = run.pixels();
        let range = (pixels.start - first) * width..(pixels.end - first) * width;
        self.is_used.then(|| &self.lists[list][range])
    }
}

/// The gradients of what surfaces put on rungs, in a band.
#[derive(Debug, Clone, Copy)]
pub(super) struct RungBars<'a, S> {
    pub(super) blurs: &'a Blurs,
    pub(super) frame: Frame,
    pub(super) at_rungs: &'a Strips<S>,
}

/// Gradients of the surfaces in a band.
#[derive(Debug, Default)]
pub(super) struct BandBars<S> {
    pub(super) layers: Vec<LayerBars<S>>,
    /// Visible pieces, and for each its gradients: of the colour, the alpha, the distance and its slope.
    pub(super) pieces: Vec<u32>,
    pub(super) piece_bars: Vec<S>,
    /// Visible pieces, and the gradients of their weights.
    pub(super) weights: Vec<(u32, S)>,
    /// Of aperture and focus.
    pub(super) optics: [S; 2],
    /// Of a background colour, or of the background of the band's pixels.
    pub(super) background: Vec<S>,
    pixels: usize,
    /// E at rungs k and k + 1.
    beside: [Vec<S>; 2],
    /// The derivatives of these by a shift, to the right and down.
    moved: [[Vec<S>; 2]; 2],
}

impl<S: Scalar> BandBars<S> {
    /// Forgets all gradients.
    pub(super) fn clear<T: Scalar<Wide = S>>(&mut self, view: &View<'_, T>, pixels: usize) {
        self.layers.resize_with(view.layers.len(), LayerBars::default);
        self.layers.iter_mut().for_each(|layer| layer.is_used = false);
        self.pieces.clear();
        self.piece_bars.clear();
        self.weights.clear();
        self.optics = [S::ZERO; 2];
        self.background.clear();
        let count = if view.kind == Kind::Image { pixels } else { 1 };
        self.background.resize(count * view.channels, S::ZERO);
        self.pixels = pixels;
    }

    /// Adds the gradients of what the pixels of a span show.
    #[inline(always)]
    pub(super) fn add_span<T: Scalar<Wide = S>>(
        &mut self,
        rungs: RungBars<'_, S>,
        view: &View<'_, T>,
        span: &Span,
        lines: &mut Lines<S>,
    ) {
        let RungBars { blurs, frame, at_rungs } = rungs;
        span.for_each_part(view, |span, between| {
            let rung = between.rung;
            let strips = [rung, rung + 1].map(|rung| at_rungs.get(rung));
            if strips.iter().all(Option::is_none) {
                return;
            }
            lines.read(view, span, rung);
            for (k, strip) in strips.into_iter().enumerate() {
                // Without a share, its columns need not be held there.
                let strip = strip.filter(|_| k == 0 || between.has_next);
                lines.read_bars(frame.size, blurs.halvings[rung + k], span, k == 1, strip);
            }
            lines.mix(view.reference);
            self.add_lines(view, span, lines);
        });
    }

    /// Adds the gradients in `lines`.
    #[inline(always)]
    fn add_lines<T: Scalar<Wide = S>>(
        &mut self,
        view: &View<'_, T>,
        span: &Span,
        lines: &Lines<S>,
    ) {
        let (count, channels) = (span.columns.len(), view.channels);
        let bars = &lines.bars[0];
        let first = span.row % ROWS * view.visible.size().width + span.columns.start;
        if span.surface == Surface::BACKGROUND {
            for (channel, line) in bars.chunks_exact(count).take(channels).enumerate() {
                for (k, &bar) in line.iter().enumerate() {
                    self.background[view.kind.entry(channels, first + k) + channel] += bar;
                }
            }
            let radius_bar: S =
                lines.next_bars.iter().zip(&lines.slopes).map(|(&bar, &slope)| bar * slope).sum();
            self.optics[0] += radius_bar * view.sky.by_aperture;
            self.optics[1] += radius_bar * view.sky.by_focus;
            return;
        }
        let lists = self.layers[0].used(channels, &view.layers[0], self.pixels);
        let [colors, alphas, distances, _] = lists;
        let colors = &mut colors[first * channels..][..count * channels];
        for (channel, line) in bars.chunks_exact(count).take(channels).enumerate() {
            for k in 0..count {
                colors[k * channels + channel] += line[k];
            }
        }
        let (alphas, last) = (&mut alphas[first..][..count], &bars[channels * count..]);
        for k in 0..count {
            alphas[k] += last[k] - lines.reference_bars[k];
        }
        let distances = &mut distances[first..][..count];
        for (k, to) in distances.iter_mut().enumerate() {
            let radius_bar = lines.next_bars[k] * lines.slopes[k];
            let circle = view.circle(span.surface_at(span.columns.start + k));
            self.optics[0] += radius_bar * circle.by_aperture;
            self.optics[1] += radius_bar * circle.by_focus;
            *to += radius_bar * circle.by_distance;
        }
    }

    /// Adds the gradients of what a pixel shows.
    pub(super) fn add_pixel<T: Scalar<Wide = S>>(
        &mut self,
        rungs: RungBars<'_, S>,
        view: &View<'_, T>,
        place: [usize; 2],
        parts: &Parts<S>,
        link_bars: &mut Vec<LinkBar<S>>,
    ) {
        let zero = S::ZERO;
        let pixel = place[0] * rungs.frame.size.width + place[1];
        link_bars.clear();
        link_bars.resize(parts.chain.len(), LinkBar { alpha: zero, radius: zero });
        for part in &parts.parts {
            if !self.read_rungs(rungs, place, part, view.channels) {
                continue;
            }
            let tilt_bar = match view.slope(part.surface) {
                Some(slope) if part.is_moved() => self.tilt_bar(view, part, pixel, slope),
                _ => TiltBar::ZERO,
            };
            let (share_bar, next_bar) = self.mix(view, part, pixel);
            let radius = part.share * next_bar * part.position.slope + tilt_bar.radius;
            self.add_surface(view, part.surface, place, part.share, TiltBar { radius, ..tilt_bar });
            match part.kind {
                Share::Whole => {}
                Share::Piece => self.weights.push((part.surface.fragment, share_bar)),
                Share::Left => self.take_from_pieces(parts, share_bar),
                Share::Beside => {
                    self.add_beside(view, place, parts, share_bar, &mut link_bars[0]);
                }
                Share::Behind(last) => {
                    let chain = &parts.chain[..=last as usize];
                    pull_back_share(chain, parts.least_radius, share_bar, link_bars);
                }
            }
        }
        for (link, bar) in parts.chain.iter().zip(&*link_bars) {
            self.add_hiding(view, link.surface, place, *bar);
        }
    }

    /// E at the rungs of a part, in `beside`; whether there is any.
    #[inline]
    fn read_rungs(
        &mut self,
        rungs: RungBars<'_, S>,
        [row, column]: [usize; 2],
        part: &Part<S>,
        channels: usize,
    ) -> bool {
        let RungBars { blurs, frame, at_rungs } = rungs;
        let rung = part.position.rung;
        let strips = [rung, rung + 1].map(|rung| at_rungs.get(rung));
        if strips.iter().all(Option::is_none) {
            return false;
        }
        for (k, strip) in strips.into_iter().enumerate() {
            let moved = if part.is_moved() { &mut self.moved[k][..] } else { &mut [] };
            for list in std::iter::once(&mut self.beside[k]).chain(moved) {
                list.clear();
                list.resize(channels + 1, S::ZERO);
            }
            let Some(strip) = strip else { continue };
            let halvings = blurs.halvings[rung + k];
            let mean = S::from_f64(mean_weight(frame.size, halvings, [row, column]));
            let [x, y] = &mut self.moved[k];
            let mut add = |[row, column]: [usize; 2], weights: [S; 3]| {
                let Some(offset) = strip.held_offset(row, column) else { return };
                let numbers = strip.values[offset..].iter().step_by(strip.plane());
                for (channel, &number) in numbers.enumerate() {
                    self.beside[k][channel] += weights[0] * number;
                    if part.is_moved() {
                        x[channel] += weights[1] * number;
                        y[channel] += weights[2] * number;
                    }
                }
            };
            if !part.is_moved() {
                add([row >> halvings, column >> halvings], [mean, S::ZERO, S::ZERO]);
                continue;
            }
            let small = halved(frame.size, halvings);
            let [columns, rows] = tilt::taps(small, halvings, [row, column], part.shift);
            for (row, share_y, slope_y) in rows {
                for (column, share_x, slope_x) in columns {
                    let weights = [share_x * share_y, slope_x * share_y, share_x * slope_y];
                    add([row, column], weights.map(|weight| mean * weight));
                }
            }
        }
        true
    }

    /// The gradients of what a part's shift is made of.
    fn tilt_bar<T: Scalar<Wide = S>>(
        &self,
        view: &View<'_, T>,
        part: &Part<S>,
        pixel: usize,
        slope: [S; 2],
    ) -> TiltBar<S> {
        let (color, alpha) = view.color(part.surface, pixel);
        let next = part.position.next;
        let shares = [S::ONE - next, next];
        let mut shift_bar = [S::ZERO; 2];
        for channel in 0..=color.len() {
            let value = match color.get(channel) {
                Some(color) => color.widen() - alpha.widen() * view.reference[channel].widen(),
                None => alpha.widen(),
            };
            for (moved, share) in self.moved.iter().zip(shares) {
                for (bar, moved) in shift_bar.iter_mut().zip(moved) {
                    *bar += part.share * share * value * moved[channel];
                }
            }
        }
        TiltBar::new(&view.circle(part.surface), slope, shift_bar)
    }

    /// Makes E of a part, in `beside[0]`; returns the gradients of its share and of t.
    #[inline]
    fn mix<T: Scalar<Wide = S>>(
        &mut self,
        view: &View<'_, T>,
        part: &Part<S>,
        pixel: usize,
    ) -> (S, S) {
        let (color, alpha) = view.color(part.surface, pixel);
        let alpha = alpha.widen();
        let (mut share_bar, mut next_bar) = (S::ZERO, S::ZERO);
        let next_share = part.position.next;
        let [own, next] = &mut self.beside;
        let mut of_reference = S::ZERO;
        for (channel, (own, &next)) in own.iter_mut().zip(&*next).enumerate() {
            // What rungs hold: the difference to the reference of the same alpha; and the alpha.
            let is_color = channel < color.len();
            let value = match is_color {
                true => color[channel].widen() - alpha * view.reference[channel].widen(),
                false => alpha,
            };
            let step = next - *own;
            *own += next_share * step;
            share_bar += *own * value;
            next_bar += step * value;
            if is_color {
                of_reference += *own * view.reference[channel].widen();
            } else {
                *own -= of_reference;
            }
        }
        (share_bar, next_bar)
    }

    /// Adds the gradients of how much a surface hides.
    fn add_hiding<T: Scalar<Wide = S>>(
        &mut self,
        view: &View<'_, T>,
        surface: Surface,
        place: [usize; 2],
        bar: LinkBar<S>,
    ) {
        if bar.alpha.is_same(S::ZERO) && bar.radius.is_same(S::ZERO) {
            return;
        }
        let beside = &mut self.beside[0];
        beside.clear();
        beside.resize(view.channels, S::ZERO);
        beside.push(bar.alpha);
        let bar = TiltBar { radius: bar.radius, ..TiltBar::ZERO };
        self.add_surface(view, surface, place, S::ONE, bar);
    }

    /// Adds the gradients of the share of what pieces hide.
    fn add_beside<T: Scalar<Wide = S>>(
        &mut self,
        view: &View<'_, T>,
        place: [usize; 2],
        parts: &Parts<S>,
        share_bar: S,
        first_bar: &mut LinkBar<S>,
    ) {
        let pixel = place[0] * view.visible.size().width + place[1];
        for part in &parts.parts {
            let Some(behind) = view.behind_part(part, parts.chain[0], pixel) else { continue };
            self.weights.push((part.surface.fragment, share_bar * behind.share));
            let bar = share_bar * part.share;
            let [radius, first_radius] = behind.by_radii.map(|slope| bar * slope);
            first_bar.radius += first_radius;
            let bar = LinkBar { alpha: bar * behind.by_alpha, radius };
            self.add_hiding(view, part.surface, place, bar);
        }
    }

    /// What pieces leave is less by their weights.
    fn take_from_pieces(&mut self, parts: &Parts<S>, share_bar: S) {
        for part in &parts.parts {
            if part.kind == Share::Piece {
                self.weights.push((part.surface.fragment, -share_bar));
            }
        }
    }

    /// Adds the gradients `share` times those in `beside[0]`, of a surface's colour and alpha, and of its circle.
    fn add_surface<T: Scalar<Wide = S>>(
        &mut self,
        view: &View<'_, T>,
        surface: Surface,
        [row, column]: [usize; 2],
        share: S,
        bar: TiltBar<S>,
    ) {
        let mut distance_bar = S::ZERO;
        if !bar.radius.is_same(S::ZERO) {
            let circle = view.circle(surface);
            self.optics[0] += bar.radius * circle.by_aperture;
            self.optics[1] += bar.radius * circle.by_focus;
            distance_bar = bar.radius * circle.by_distance;
        }
        if !bar.by_distance.is_same(S::ZERO) {
            let [by_distance, by_aperture, by_focus] = view.bends(surface);
            self.optics[0] += bar.by_distance * by_aperture;
            self.optics[1] += bar.by_distance * by_focus;
            distance_bar += bar.by_distance * by_distance;
        }
        let (bars, channels) = (&self.beside[0], view.channels);
        let pixel = row % ROWS * view.visible.size().width + column;
        if surface == Surface::BACKGROUND {
            let to = &mut self.background[view.kind.entry(channels, pixel)..][..channels];
            to.iter_mut().zip(bars).for_each(|(to, &bar)| *to += share * bar);
            return;
        }
        if surface.layer == 0 && surface.fragment as usize >= view.centers() {
            self.pieces.push(surface.fragment);
            self.piece_bars.extend(bars.iter().map(|&bar| share * bar));
            self.piece_bars.push(distance_bar);
            self.piece_bars.extend(bar.slope);
            return;
        }
        let layer = surface.layer as usize;
        let [colors, alphas, distances, slopes] =
            self.layers[layer].used(channels, &view.layers[layer], self.pixels);
        let to = &mut colors[pixel * channels..][..channels];
        to.iter_mut().zip(bars).for_each(|(to, &bar)| *to += share * bar);
        alphas[pixel] += share * bars[channels];
        distances[pixel] += distance_bar;
        let to = slopes.get_mut(2 * pixel..2 * pixel + 2).unwrap_or_default();
        to.iter_mut().zip(bar.slope).for_each(|(to, bar)| *to += bar);
    }
}
