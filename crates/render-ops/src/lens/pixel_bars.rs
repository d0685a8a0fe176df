//! Gradients of the surfaces in a band: `bands` has the formulas.

use bokashi_core::Scalar;

use super::blurs::Blurs;
use super::frame::Frame;
use super::hiding::{LinkBar, Surface, pull_back_share};
use super::strips::{ROWS, Strips};
use super::surfaces::{Part, Parts, Share, View};
use crate::background::Kind;
use crate::runs::Run;

/// Gradients of a layer's fragments at pixel centres, by the pixels of a band.
#[derive(Debug, Default)]
pub(super) struct LayerBars<S> {
    /// Whether there are any; the lists are empty before.
    is_used: bool,
    /// Of the colours, the alphas, and the distances.
    lists: [Vec<S>; 3],
}

impl<S: Scalar> LayerBars<S> {
    /// The gradients of a run: of colours, alphas or distances, `width` numbers each.
    pub(super) fn of_run(
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

/// Gradients of the surfaces in a band.
#[derive(Debug)]
pub(super) struct BandBars<T: Scalar> {
    pub(super) at_rungs: Strips<T::Wide>,
    /// Per rung: its strip of `at_rungs`, counted from 1; 0 where it has none.
    pub(super) slots: Vec<u32>,
    pub(super) layers: Vec<LayerBars<T::Wide>>,
    /// Visible pieces, and for each its gradients: of the colour, of the alpha, of the distance.
    pub(super) pieces: Vec<u32>,
    pub(super) piece_bars: Vec<T::Wide>,
    /// Visible pieces, and the gradients of their weights.
    pub(super) weights: Vec<(u32, T::Wide)>,
    /// Of aperture and focus.
    pub(super) optics: [T::Wide; 2],
    /// Of a background colour, or of the background of the band's pixels.
    pub(super) background: Vec<T::Wide>,
    pixels: usize,
    /// E at rungs k and k + 1.
    beside: [Vec<T::Wide>; 2],
}

impl<T: Scalar> Default for BandBars<T> {
    fn default() -> Self {
        Self {
            at_rungs: Strips::default(),
            slots: Vec::new(),
            layers: Vec::new(),
            pieces: Vec::new(),
            piece_bars: Vec::new(),
            weights: Vec::new(),
            optics: [T::Wide::ZERO; 2],
            background: Vec::new(),
            pixels: 0,
            beside: [Vec::new(), Vec::new()],
        }
    }
}

impl<T: Scalar> BandBars<T> {
    /// Forgets all gradients.
    pub(super) fn clear(&mut self, view: &View<'_, T>, pixels: usize) {
        self.at_rungs.clear();
        self.slots.clear();
        self.layers.resize_with(view.layers.len(), LayerBars::default);
        self.layers.iter_mut().for_each(|layer| layer.is_used = false);
        self.pieces.clear();
        self.piece_bars.clear();
        self.weights.clear();
        self.optics = [T::Wide::ZERO; 2];
        self.background.clear();
        let count = if view.kind == Kind::Image { pixels } else { 1 };
        self.background.resize(count * view.channels, T::Wide::ZERO);
        self.pixels = pixels;
    }

    /// Adds the gradients of what a pixel shows.
    pub(super) fn add_pixel(
        &mut self,
        blurs: &Blurs,
        view: &View<'_, T>,
        frame: Frame,
        place: [usize; 2],
        parts: &Parts<T::Wide>,
        link_bars: &mut Vec<LinkBar<T::Wide>>,
    ) {
        let zero = T::Wide::ZERO;
        let pixel = place[0] * frame.size.width + place[1];
        link_bars.clear();
        link_bars.resize(parts.chain.len(), LinkBar { alpha: zero, radius: zero });
        for part in &parts.parts {
            let rung = part.position.rung;
            if self.slots[rung] == 0 && self.slots[rung + 1] == 0 {
                continue;
            }
            self.read_rungs(blurs, frame, place, part, view.channels);
            let (share_bar, next_bar) = self.mix(view, part, pixel);
            let radius_bar = part.share * next_bar * part.position.slope;
            self.add_surface(view, part.surface, place, part.share, radius_bar);
            match part.kind {
                Share::Whole => {}
                Share::Piece => self.weights.push((part.surface.fragment, share_bar)),
                Share::Left => self.take_from_pieces(parts, share_bar),
                Share::Beside => {
                    self.add_beside(view, place, parts, share_bar, &mut link_bars[0]);
                }
                Share::Behind(last) => {
                    pull_back_share(&parts.chain[..=last as usize], share_bar, link_bars);
                }
            }
        }
        for (link, bar) in parts.chain.iter().zip(&*link_bars) {
            self.add_hiding(view, link.surface, place, *bar);
        }
    }

    /// E at the rungs of a part, in `beside`.
    #[inline]
    fn read_rungs(
        &mut self,
        blurs: &Blurs,
        frame: Frame,
        [row, column]: [usize; 2],
        part: &Part<T::Wide>,
        channels: usize,
    ) {
        let rung = part.position.rung;
        for (k, beside) in self.beside.iter_mut().enumerate() {
            beside.resize(channels + 1, T::Wide::ZERO);
            let slot = self.slots[rung + k] as usize;
            let strip = slot.checked_sub(1).map(|slot| &self.at_rungs.as_slice()[slot]);
            let halvings = blurs.halvings[rung + k];
            let offset =
                strip.and_then(|strip| strip.held_offset(row >> halvings, column >> halvings));
            let (Some(strip), Some(offset)) = (strip, offset) else {
                beside.fill(T::Wide::ZERO);
                continue;
            };
            let weight = T::Wide::from_f64(frame.mean_weight(halvings, [row, column]));
            let colors = strip.values[offset..].iter().step_by(strip.plane());
            for (to, &number) in beside.iter_mut().zip(colors.chain([&strip.alphas[offset]])) {
                *to = number * weight;
            }
        }
    }

    /// Makes E of a part, in `beside[0]`; returns the gradients of its share and of t.
    #[inline]
    fn mix(
        &mut self,
        view: &View<'_, T>,
        part: &Part<T::Wide>,
        pixel: usize,
    ) -> (T::Wide, T::Wide) {
        let (color, alpha) = view.color(part.surface, pixel);
        let alpha = alpha.widen();
        let (mut share_bar, mut next_bar) = (T::Wide::ZERO, T::Wide::ZERO);
        // In focus the next rung holds nothing of the part.
        let next_share = match part.rungs()[1] {
            Some((_, share)) => share,
            None => T::Wide::ZERO,
        };
        let [own, next] = &mut self.beside;
        let mut of_reference = T::Wide::ZERO;
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
    fn add_hiding(
        &mut self,
        view: &View<'_, T>,
        surface: Surface,
        place: [usize; 2],
        bar: LinkBar<T::Wide>,
    ) {
        if bar.alpha.is_same(T::Wide::ZERO) && bar.radius.is_same(T::Wide::ZERO) {
            return;
        }
        let beside = &mut self.beside[0];
        beside.clear();
        beside.resize(view.channels, T::Wide::ZERO);
        beside.push(bar.alpha);
        self.add_surface(view, surface, place, T::Wide::ONE, bar.radius);
    }

    /// Adds the gradients of the share of what pieces hide.
    fn add_beside(
        &mut self,
        view: &View<'_, T>,
        place: [usize; 2],
        parts: &Parts<T::Wide>,
        share_bar: T::Wide,
        first_bar: &mut LinkBar<T::Wide>,
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
    fn take_from_pieces(&mut self, parts: &Parts<T::Wide>, share_bar: T::Wide) {
        for part in &parts.parts {
            if part.kind == Share::Piece {
                self.weights.push((part.surface.fragment, -share_bar));
            }
        }
    }

    /// Adds the gradients `share` times those in `beside[0]`, of a surface's colour and alpha, and of its radius.
    fn add_surface(
        &mut self,
        view: &View<'_, T>,
        surface: Surface,
        [row, column]: [usize; 2],
        share: T::Wide,
        radius_bar: T::Wide,
    ) {
        let mut distance_bar = T::Wide::ZERO;
        if !radius_bar.is_same(T::Wide::ZERO) {
            let circle = view.circle(surface);
            self.optics[0] += radius_bar * circle.by_aperture;
            self.optics[1] += radius_bar * circle.by_focus;
            distance_bar = radius_bar * circle.by_distance;
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
            return;
        }
        let LayerBars { is_used, lists } = &mut self.layers[surface.layer as usize];
        if !*is_used {
            *is_used = true;
            for (list, width) in lists.iter_mut().zip([channels, 1, 1]) {
                list.clear();
                list.resize(self.pixels * width, T::Wide::ZERO);
            }
        }
        let [colors, alphas, distances] = lists;
        let to = &mut colors[pixel * channels..][..channels];
        to.iter_mut().zip(bars).for_each(|(to, &bar)| *to += share * bar);
        alphas[pixel] += share * bars[channels];
        distances[pixel] += distance_bar;
    }
}
