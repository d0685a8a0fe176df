//! Gradients of the surfaces in a band: `bands` has the formulas.

use bokashi_core::Scalar;

use super::frame::Frame;
use super::hiding::{LinkBar, Surface, pull_back_share};
use super::surfaces::{Part, Parts, Share, View};
use crate::background::Kind;
use crate::defocus::{Blurs, ROWS, Strips, mean_weight};
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
    /// Visible pieces, and for each its gradients: of the colour, of the alpha, of the distance.
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
        for ((k, beside), strip) in self.beside.iter_mut().enumerate().zip(strips) {
            beside.resize(channels + 1, S::ZERO);
            let halvings = blurs.halvings[rung + k];
            let offset =
                strip.and_then(|strip| strip.held_offset(row >> halvings, column >> halvings));
            let (Some(strip), Some(offset)) = (strip, offset) else {
                beside.fill(S::ZERO);
                continue;
            };
            let weight = S::from_f64(mean_weight(frame.size, halvings, [row, column]));
            let numbers = strip.values[offset..].iter().step_by(strip.plane());
            beside.iter_mut().zip(numbers).for_each(|(to, &number)| *to = number * weight);
        }
        true
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
        // In focus the next rung holds nothing of the part.
        let next_share = match part.rungs()[1] {
            Some((_, share)) => share,
            None => S::ZERO,
        };
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
        self.add_surface(view, surface, place, S::ONE, bar.radius);
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

    /// Adds the gradients `share` times those in `beside[0]`, of a surface's colour and alpha, and of its radius.
    fn add_surface<T: Scalar<Wide = S>>(
        &mut self,
        view: &View<'_, T>,
        surface: Surface,
        [row, column]: [usize; 2],
        share: S,
        radius_bar: S,
    ) {
        let mut distance_bar = S::ZERO;
        if !radius_bar.is_same(S::ZERO) {
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
                list.resize(self.pixels * width, S::ZERO);
            }
        }
        let [colors, alphas, distances] = lists;
        let to = &mut colors[pixel * channels..][..channels];
        to.iter_mut().zip(bars).for_each(|(to, &bar)| *to += share * bar);
        alphas[pixel] += share * bars[channels];
        distances[pixel] += distance_bar;
    }
}
