//! The surfaces of all layers, and what of them a pixel shows.
//!
//! # Forward
//! What is visible has its share of the pixel: 1 for a fragment at the centre, the weight of a piece of exact
//! coverage, and for the background what is left. What the nearest surface at the pixel's centre hides is
//! shown, too, as far as the lens can see it: with the share of `hiding`, the background last. So is, of that
//! surface, what pieces of exact coverage hide.
//!
//! # Backward
//! The gradient of a share is that of the piece's weight, is taken from all pieces' weights for the
//! background, and is pulled back through `hiding` for what is hidden.

use bokashi_core::Scalar;

use super::circles::{Circle, Optics};
use super::hiding::{Behind, Link, behind_piece, share_behind};
use super::rungs::{Place, Rungs};
use crate::background::Kind;
use crate::coverage::Coverage;

/// Stands for "nothing" in a list of surfaces, and for the background in a list of parts.
pub(super) const NONE: u32 = u32::MAX;

/// A share of a pixel that is less is rounding.
const LEAST_SHARE: f64 = 1e-6;

/// The fragments of all layers, one after another: those of the visible layer, then those behind.
#[derive(Debug)]
pub(super) struct Surfaces<T> {
    pub(super) channels: usize,
    /// Colours times alpha, `[N, C]`.
    pub(super) colors: Vec<T>,
    pub(super) alphas: Vec<T>,
    pub(super) distances: Vec<T>,
    /// Of the visible layer's pieces.
    pub(super) weights: Vec<T>,
    /// How many of the visible layer's fragments lie at pixel centres.
    pub(super) centers: usize,
    /// Per pixel: the visible fragment at its centre, where it is no boundary pixel.
    seen: Vec<u32>,
    /// Per layer at pixel centres, and per pixel: what is there.
    chain: Vec<Vec<u32>>,
    /// Whether a share of 0 has a gradient that someone could ask for.
    pub(super) keeps_hidden: bool,
}

impl<T> Default for Surfaces<T> {
    fn default() -> Self {
        Self {
            channels: 0,
            colors: Vec::new(),
            alphas: Vec::new(),
            distances: Vec::new(),
            weights: Vec::new(),
            centers: 0,
            seen: Vec::new(),
            chain: Vec::new(),
            keeps_hidden: false,
        }
    }
}

/// What a share is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Share {
    /// All of the pixel.
    Whole,
    /// The weight of the visible piece.
    Piece(u32),
    /// What pieces leave.
    Left,
    /// That of what is at the centre, behind pieces.
    Beside,
    /// That of this link of the chain.
    Behind(u32),
}

/// What a pixel shows of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part<S> {
    /// The surface; [`NONE`] for the background.
    pub(super) surface: u32,
    pub(super) kind: Share,
    pub(super) share: S,
    pub(super) circle: Circle<S>,
    pub(super) place: Place<S>,
}

/// What a pixel shows, and what is at its centre.
#[derive(Debug)]
pub(super) struct Parts<S> {
    pub(super) parts: Vec<Part<S>>,
    pub(super) chain: Vec<Link<S>>,
    /// A number that tells on which smooth piece they lie.
    pub(super) piece: u64,
}

impl<S> Default for Parts<S> {
    fn default() -> Self {
        Self { parts: Vec::new(), chain: Vec::new(), piece: 0 }
    }
}

/// Numbers that all surfaces share.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a, T: Scalar> {
    pub(super) surfaces: &'a Surfaces<T>,
    pub(super) visible: &'a Coverage,
    pub(super) rungs: &'a Rungs,
    pub(super) optics: Optics<T::Wide>,
    /// The circle of the background.
    pub(super) sky: Circle<T::Wide>,
    pub(super) background: &'a [T],
    pub(super) kind: Kind,
}

impl<T: Scalar> Surfaces<T> {
    /// Forgets all layers.
    pub(super) fn clear(&mut self, channels: usize) {
        self.channels = channels;
        for list in [&mut self.colors, &mut self.alphas, &mut self.distances, &mut self.weights] {
            list.clear();
        }
    }

    /// Adds a layer.
    pub(super) fn add(&mut self, [colors, alphas, distances]: [&[T]; 3]) {
        self.colors.extend_from_slice(colors);
        self.alphas.extend_from_slice(alphas);
        self.distances.extend_from_slice(distances);
    }

    /// Finds what is at each pixel; returns the first pixel, with its layer, that a layer behind covers and the
    /// layer in front of it does not.
    pub(super) fn find<'a>(
        &mut self,
        visible: &Coverage,
        mut behind: impl Iterator<Item = &'a Coverage>,
    ) -> Option<[usize; 2]> {
        let pixels = visible.size().pixels();
        let empty = |list: &mut Vec<u32>| {
            list.clear();
            list.resize(pixels, NONE);
        };
        empty(&mut self.seen);
        self.centers = visible.centers();
        for (at, pixel) in visible.pixels().take(self.centers).enumerate() {
            self.seen[pixel] = at as u32;
        }
        let mut used = 0;
        let mut first = visible.count();
        let mut fault = None;
        loop {
            let layer = behind.next();
            if layer.is_none() && used > 0 {
                break;
            }
            if self.chain.len() == used {
                self.chain.push(Vec::new());
            }
            let (before, own) = self.chain.split_at_mut(used);
            let own = &mut own[0];
            empty(own);
            match layer {
                // What is visible hides the background.
                None => {
                    own.copy_from_slice(&self.seen);
                    for (at, &pixel) in visible.boundary.pixels.iter().enumerate() {
                        own[pixel as usize] = visible.boundary.largest_of(at).unwrap_or(NONE);
                    }
                }
                Some(layer) => {
                    for (at, pixel) in layer.pixels().enumerate() {
                        own[pixel] = (first + at) as u32;
                        if before.last().is_some_and(|before| before[pixel] == NONE) {
                            fault = fault.or(Some([used, pixel]));
                        }
                    }
                    first += layer.count();
                }
            }
            used += 1;
        }
        self.chain.truncate(used);
        fault
    }

    /// The bytes that it holds, for reports.
    pub(super) fn bytes(&self) -> usize {
        let numbers = [&self.colors, &self.alphas, &self.distances, &self.weights];
        let maps = self.chain.iter().chain([&self.seen]);
        numbers.iter().map(|list| size_of_val(&list[..])).sum::<usize>()
            + maps.map(|list| size_of_val(&list[..])).sum::<usize>()
    }
}

impl<'a, T: Scalar> View<'a, T> {
    /// The colour times alpha, and the alpha, of a surface at a pixel.
    pub(super) fn color(&self, surface: u32, pixel: usize) -> (&'a [T], T) {
        let (surfaces, channels) = (self.surfaces, self.surfaces.channels);
        if surface == NONE {
            let entry = self.kind.entry(channels, pixel);
            return (&self.background[entry..][..channels], T::ONE);
        }
        let at = surface as usize;
        (&surfaces.colors[at * channels..][..channels], surfaces.alphas[at])
    }

    /// The colour that rungs hold the difference to, so that what looks like it adds no rounding: the
    /// background's. The picture is the same for any.
    pub(super) fn reference(&self) -> &'a [T] {
        &self.background[..self.surfaces.channels]
    }

    /// The circle of a surface.
    pub(super) fn circle(&self, surface: u32) -> Circle<T::Wide> {
        if surface == NONE {
            return self.sky;
        }
        self.optics.circle(self.surfaces.distances[surface as usize].widen())
    }

    /// What a pixel shows. `pieces` are its fragments, where it is a boundary pixel.
    pub(super) fn find_parts(
        &self,
        pixel: usize,
        pieces: Option<&[u32]>,
        found: &mut Parts<T::Wide>,
    ) {
        let surfaces = self.surfaces;
        found.parts.clear();
        found.piece = 0;
        let one = T::Wide::ONE;
        match (pieces, surfaces.seen[pixel]) {
            (Some(pieces), _) => {
                let mut left = one;
                for &piece in pieces {
                    let weight = surfaces.weights[piece as usize - surfaces.centers].widen();
                    left -= weight;
                    self.add_part(piece, Share::Piece(piece), weight, found);
                }
                if left.to_f64() > LEAST_SHARE {
                    self.add_part(NONE, Share::Left, left, found);
                }
            }
            (None, surface) => self.add_part(surface, Share::Whole, one, found),
        }
        self.find_chain(pixel, found);
        if pieces.is_some() {
            self.add_beside(pixel, found);
        }
        for last in 1..found.chain.len() {
            let (share, piece) = share_behind(&found.chain[..=last]);
            found.piece = found.piece.wrapping_mul(31).wrapping_add(piece);
            if share != T::Wide::ZERO || surfaces.keeps_hidden {
                let surface = found.chain[last].surface;
                self.add_part(surface, Share::Behind(last as u32), share, found);
            }
        }
    }

    /// What is at a pixel's centre, the nearest first, and the background last.
    fn find_chain(&self, pixel: usize, found: &mut Parts<T::Wide>) {
        found.chain.clear();
        for layer in &self.surfaces.chain {
            let surface = layer[pixel];
            if surface == NONE {
                break;
            }
            let alpha = self.surfaces.alphas[surface as usize].widen();
            found.chain.push(Link { surface, alpha, circle: self.circle(surface) });
        }
        found.chain.push(Link { surface: NONE, alpha: T::Wide::ONE, circle: self.sky });
    }

    /// Adds what is hidden by pieces of the surface at the centre.
    fn add_beside(&self, pixel: usize, found: &mut Parts<T::Wide>) {
        let first = found.chain[0];
        let (mut share, mut is_seen) = (T::Wide::ZERO, self.surfaces.keeps_hidden);
        for part in &found.parts {
            let Some((_, behind)) = self.behind(part, first, pixel) else { continue };
            share += part.share * behind.share;
            is_seen |= behind.share != T::Wide::ZERO;
            found.piece = found.piece.wrapping_mul(7).wrapping_add(1 + u64::from(behind.piece));
        }
        if is_seen {
            self.add_part(first.surface, Share::Beside, share, found);
        }
    }

    /// The piece that a part is, and what is seen behind it of what is at the centre.
    pub(super) fn behind(
        &self,
        part: &Part<T::Wide>,
        first: Link<T::Wide>,
        pixel: usize,
    ) -> Option<(u32, Behind<T::Wide>)> {
        let Share::Piece(piece) = part.kind else { return None };
        let alpha = self.color(part.surface, pixel).1.widen();
        Some((piece, behind_piece(alpha, part.circle.radius, first.circle.radius)?))
    }

    fn add_part(&self, surface: u32, kind: Share, share: T::Wide, found: &mut Parts<T::Wide>) {
        let circle = self.circle(surface);
        let place = self.rungs.place(circle.radius);
        // Whether a share of 0 is listed depends on who asks.
        if share != T::Wide::ZERO {
            let at = 2 * place.rung as u64 + u64::from(circle.is_capped);
            found.piece = found.piece.wrapping_mul(1009).wrapping_add(at);
        }
        found.parts.push(Part { surface, kind, share, circle, place });
    }
}
