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

use std::ops::Range;

use bokashi_core::Scalar;

use super::circles::{Circle, Optics};
use super::disocclusion::Disocclusion;
use super::hiding::{Behind, LEAST_SHARE, Link, Surface, behind_piece, share_behind};
use super::tilt;
use crate::background::Kind;
use crate::coverage::Coverage;
use crate::defocus::{Position, Rungs};

/// Stands for "no fragment".
const NONE: u32 = u32::MAX;

/// What an operation is given of a layer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layer<'a, T> {
    /// Colours times alpha, `[N, C]`.
    pub(super) colors: &'a [T],
    pub(super) alphas: &'a [T],
    pub(super) distances: &'a [T],
    /// How distances change from pixel to pixel, `[N, 2]`, or nothing.
    pub(super) slopes: &'a [T],
    /// Of the circles of confusion.
    pub(super) radii: &'a [T],
}

/// What a share is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Share {
    /// All of the pixel.
    Whole,
    /// The weight of a visible piece.
    Piece,
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
    pub(super) surface: Surface,
    pub(super) kind: Share,
    pub(super) share: S,
    /// Of its circle, and where it lies among the rungs.
    pub(super) radius: S,
    pub(super) position: Position<S>,
    /// How far to the right and down it is moved, in pixels.
    pub(super) shift: [S; 2],
}

impl<S: Scalar> Part<S> {
    pub(super) fn is_moved(&self) -> bool {
        self.shift.iter().any(|&shift| shift != S::ZERO)
    }
}

/// What a pixel shows, and what is at its centre, the nearest first.
#[derive(Debug)]
pub(super) struct Parts<S> {
    pub(super) parts: Vec<Part<S>>,
    pub(super) chain: Vec<Link<S>>,
    /// The least radius of what can be seen behind the first of the chain.
    pub(super) least_radius: f64,
    /// A number that tells on which smooth piece they lie.
    pub(super) piece: u64,
}

impl<S> Default for Parts<S> {
    fn default() -> Self {
        Self { parts: Vec::new(), chain: Vec::new(), least_radius: 0.0, piece: 0 }
    }
}

/// Neighbouring pixels of a row that show one surface as a whole.
#[derive(Debug, Clone)]
pub(super) struct Span {
    pub(super) row: usize,
    pub(super) columns: Range<usize>,
    /// What the first pixel shows; the others show the fragments after it, or the background, too.
    pub(super) surface: Surface,
}

impl Span {
    /// What a column of it shows.
    #[inline(always)]
    pub(super) fn surface_at(&self, column: usize) -> Surface {
        let Surface { layer, fragment } = self.surface;
        if self.surface == Surface::BACKGROUND {
            return self.surface;
        }
        Surface { layer, fragment: fragment + (column - self.columns.start) as u32 }
    }
}

/// What some pixels show.
#[derive(Debug)]
pub(super) enum Shown<'a, S> {
    /// Of several, one surface each.
    Span(Span),
    /// Of one, at this row and column, all of it.
    Pixel([usize; 2], &'a Parts<S>),
}

/// The fragments of a row of pixels.
#[derive(Debug, Default)]
pub(super) struct Row {
    /// The visible ones at pixel centres, where these are no boundary pixels.
    visible: Vec<u32>,
    /// Per layer at pixel centres, from the nearest on.
    chain: Vec<Vec<u32>>,
}

/// All surfaces, and the lens.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a, T: Scalar> {
    pub(super) channels: usize,
    pub(super) layers: &'a [Layer<'a, T>],
    /// Of the visible layer's pieces.
    pub(super) weights: &'a [T],
    pub(super) visible: &'a Coverage,
    pub(super) behind: &'a [&'a Coverage],
    pub(super) rungs: &'a Rungs,
    pub(super) disocclusion: &'a Disocclusion,
    pub(super) optics: Optics<T::Wide>,
    /// The circle of the background, and where it lies among the rungs.
    pub(super) sky: Circle<T::Wide>,
    pub(super) sky_position: Position<T::Wide>,
    pub(super) background: &'a [T],
    pub(super) kind: Kind,
    /// The colour that rungs hold the difference to, so that what looks like it adds no rounding: that of a
    /// background of one colour. The picture is the same for any.
    pub(super) reference: &'a [T],
    /// Whether a share of 0 has a gradient that someone could ask for.
    pub(super) keeps_hidden: bool,
}

impl<'a, T: Scalar> View<'a, T> {
    /// The colour times alpha, and the alpha, of a surface at a pixel.
    #[inline]
    pub(super) fn color(&self, surface: Surface, pixel: usize) -> (&'a [T], T) {
        let channels = self.channels;
        if surface == Surface::BACKGROUND {
            let entry = self.kind.entry(channels, pixel);
            return (&self.background[entry..][..channels], T::ONE);
        }
        let (layer, row) = (&self.layers[surface.layer as usize], surface.fragment as usize);
        (&layer.colors[row * channels..][..channels], layer.alphas[row])
    }

    /// How many rows beyond its own a surface may be moved to.
    pub(super) fn reach(&self) -> usize {
        let is_tilted = self.layers.iter().any(|layer| !layer.slopes.is_empty());
        if is_tilted { tilt::REACH } else { 0 }
    }

    /// The colours of surfaces side by side from a pixel on: those of all, or one.
    #[inline(always)]
    pub(super) fn colors(&self, first: Surface, pixel: usize, count: usize) -> &'a [T] {
        let channels = self.channels;
        if first == Surface::BACKGROUND {
            let entry = self.kind.entry(channels, pixel);
            let count = if self.kind == Kind::Image { count } else { 1 };
            return &self.background[entry..][..count * channels];
        }
        let row = first.fragment as usize;
        &self.layers[first.layer as usize].colors[row * channels..][..count * channels]
    }

    /// The alphas and the radii of surfaces side by side; nothing of the background.
    #[inline(always)]
    pub(super) fn alphas_and_radii(&self, first: Surface, count: usize) -> (&'a [T], &'a [T]) {
        if first == Surface::BACKGROUND {
            return (&[], &[]);
        }
        let (layer, row) = (&self.layers[first.layer as usize], first.fragment as usize);
        (&layer.alphas[row..][..count], &layer.radii[row..][..count])
    }

    /// The radius of a surface's circle.
    #[inline]
    pub(super) fn radius(&self, surface: Surface) -> T::Wide {
        if surface == Surface::BACKGROUND {
            return self.sky.radius;
        }
        self.layers[surface.layer as usize].radii[surface.fragment as usize].widen()
    }

    /// How the distance of a surface changes from pixel to pixel, where that is known.
    #[inline]
    pub(super) fn slope(&self, surface: Surface) -> Option<[T::Wide; 2]> {
        if surface == Surface::BACKGROUND {
            return None;
        }
        let first = 2 * surface.fragment as usize;
        let slopes = self.layers[surface.layer as usize].slopes.get(first..first + 2)?;
        Some([slopes[0].widen(), slopes[1].widen()])
    }

    /// The circle of a surface.
    pub(super) fn circle(&self, surface: Surface) -> Circle<T::Wide> {
        if surface == Surface::BACKGROUND {
            return self.sky;
        }
        let distances = self.layers[surface.layer as usize].distances;
        self.optics.circle(distances[surface.fragment as usize].widen())
    }

    /// The derivatives of `ds/dz` of a surface, by distance, aperture and focus.
    pub(super) fn bends(&self, surface: Surface) -> [T::Wide; 3] {
        let distances = self.layers[surface.layer as usize].distances;
        self.optics.bends(distances[surface.fragment as usize].widen())
    }

    /// How many of the visible layer's fragments lie at pixel centres.
    pub(super) fn centers(&self) -> usize {
        self.visible.centers()
    }

    /// Calls `visit` with what the pixels of some rows show. Returns the first pixel, with its layer, that a layer
    /// behind covers and the layer in front of it does not.
    pub(super) fn for_each_shown(
        &self,
        rows: Range<usize>,
        memory: &mut Row,
        parts: &mut Parts<T::Wide>,
        mut visit: impl FnMut(Shown<'_, T::Wide>),
    ) -> Option<[usize; 2]> {
        let boundary = &self.visible.boundary;
        let width = self.visible.size().width;
        let first = rows.start * width;
        let mut next = boundary.pixels.partition_point(|&pixel| (pixel as usize) < first);
        let mut fault = None;
        for row in rows {
            fault = fault.or(self.list_row(row, next, memory));
            let mut column = 0;
            while column < width {
                let pixel = boundary.pixels.get(next).map(|&pixel| pixel as usize - row * width);
                let end = pixel.unwrap_or(width).min(width);
                if let Some(span) = self.find_span(row, column..end, memory) {
                    column = span.columns.end;
                    visit(Shown::Span(span));
                    continue;
                }
                let mut pieces = None;
                if column == end {
                    pieces = Some(boundary.fragments_of(next));
                    next += 1;
                }
                self.find_parts([row, column], pieces, memory, parts);
                visit(Shown::Pixel([row, column], parts));
                column += 1;
            }
        }
        fault
    }

    /// Lists the fragments of a row, in which boundary pixel `boundary` is the first one.
    fn list_row(&self, row: usize, boundary: usize, memory: &mut Row) -> Option<[usize; 2]> {
        let width = self.visible.size().width;
        let first = row * width;
        let Row { visible, chain } = memory;
        let fill = |coverage: &Coverage, list: &mut Vec<u32>| {
            list.clear();
            list.resize(width, NONE);
            for run in coverage.runs_in_row(row) {
                let list = &mut list[run.pixels().start - first..run.pixels().end - first];
                list.iter_mut().zip(run.fragment..).for_each(|(to, fragment)| *to = fragment);
            }
        };
        fill(self.visible, visible);
        chain.resize_with(self.behind.len().max(1), Vec::new);
        if self.behind.is_empty() {
            // What is visible hides the background.
            chain[0].clone_from(visible);
            let pixels = self.visible.boundary.pixels[boundary..].iter().enumerate();
            for (k, &pixel) in pixels.take_while(|&(_, &pixel)| (pixel as usize) < first + width) {
                let largest = self.visible.boundary.largest_of(boundary + k);
                chain[0][pixel as usize - first] = largest.unwrap_or(NONE);
            }
        }
        let mut fault = None;
        for (layer, coverage) in self.behind.iter().enumerate() {
            let (before, own) = chain.split_at_mut(layer);
            fill(coverage, &mut own[0]);
            if let Some(before) = before.last() {
                let pairs = before.iter().zip(&own[0]);
                let column = pairs.into_iter().position(|(&a, &b)| a == NONE && b != NONE);
                fault = fault.or(column.map(|column| [layer, first + column]));
            }
        }
        fault
    }

    /// The longest span at the start of some columns without boundary pixels, if there is one.
    fn find_span(&self, row: usize, columns: Range<usize>, list: &Row) -> Option<Span> {
        if columns.is_empty() || self.keeps_hidden {
            return None;
        }
        // What is moved is added to several pixels.
        let is_still = |fragment: u32| {
            let surface = Surface { layer: 0, fragment };
            let slope = if fragment == NONE { None } else { self.slope(surface) };
            slope.is_none_or(|slope| {
                let zero = T::Wide::ZERO;
                slope == [zero; 2] || tilt::shift(&self.circle(surface), slope) == [zero; 2]
            })
        };
        let first = list.visible[columns.start];
        let mut end = columns.start;
        while end < columns.end {
            if (end == columns.start || Disocclusion::starts_tile(end))
                && !self.is_closed([row, end])
            {
                break;
            }
            let ahead = (end - columns.start) as u32;
            let fragment = if first == NONE { NONE } else { first + ahead };
            if list.visible[end] != fragment || !is_still(fragment) {
                break;
            }
            end += 1;
        }
        let surface = match first {
            NONE => Surface::BACKGROUND,
            fragment => Surface { layer: 0, fragment },
        };
        (end > columns.start).then_some(Span { row, columns: columns.start..end, surface })
    }

    /// Whether nothing hidden can be seen at a pixel: no radius is larger than that of what is infinitely far.
    #[inline(always)]
    fn is_closed(&self, place: [usize; 2]) -> bool {
        self.disocclusion.least_radius(place) > self.optics.aperture.to_f64()
    }

    /// What a pixel shows. `pieces` are its fragments, where it is a boundary pixel.
    fn find_parts(
        &self,
        place: [usize; 2],
        pieces: Option<&[u32]>,
        list: &Row,
        found: &mut Parts<T::Wide>,
    ) {
        found.parts.clear();
        found.chain.clear();
        found.piece = 0;
        found.least_radius = self.disocclusion.least_radius(place);
        let one = T::Wide::ONE;
        match pieces {
            Some(pieces) => {
                let mut left = one;
                for &fragment in pieces {
                    let weight = self.weights[fragment as usize - self.centers()].widen();
                    left -= weight;
                    self.add_part(Surface { layer: 0, fragment }, Share::Piece, weight, found);
                }
                if left.to_f64() > LEAST_SHARE {
                    self.add_part(Surface::BACKGROUND, Share::Left, left, found);
                }
            }
            None => {
                let surface = match list.visible[place[1]] {
                    NONE => Surface::BACKGROUND,
                    fragment => Surface { layer: 0, fragment },
                };
                self.add_part(surface, Share::Whole, one, found);
            }
        }
        if pieces.is_none() && !self.keeps_hidden && self.is_closed(place) {
            return;
        }
        self.find_chain(place[1], list, found);
        if pieces.is_some() {
            self.add_beside(place[0] * self.visible.size().width + place[1], found);
        }
        for last in 1..found.chain.len() {
            let (share, piece) = share_behind(&found.chain[..=last], found.least_radius);
            found.piece = found.piece.wrapping_mul(31).wrapping_add(piece);
            if share != T::Wide::ZERO || self.keeps_hidden {
                let surface = found.chain[last].surface;
                self.add_part(surface, Share::Behind(last as u32), share, found);
            }
        }
    }

    /// What is at a pixel's centre, the nearest first, and the background last.
    fn find_chain(&self, column: usize, row: &Row, found: &mut Parts<T::Wide>) {
        let first = u32::from(!self.behind.is_empty());
        for (layer, list) in (first..).zip(&row.chain) {
            let fragment = list[column];
            if fragment == NONE {
                break;
            }
            let surface = Surface { layer, fragment };
            let alpha = self.layers[layer as usize].alphas[fragment as usize].widen();
            found.chain.push(Link { surface, alpha, radius: self.radius(surface) });
        }
        let (surface, alpha) = (Surface::BACKGROUND, T::Wide::ONE);
        found.chain.push(Link { surface, alpha, radius: self.sky.radius });
    }

    /// Adds what is hidden by pieces of the surface at the centre.
    fn add_beside(&self, pixel: usize, found: &mut Parts<T::Wide>) {
        let first = found.chain[0];
        let (mut share, mut is_seen) = (T::Wide::ZERO, self.keeps_hidden);
        for part in &found.parts {
            let Some(behind) = self.behind_part(part, first, pixel) else { continue };
            share += part.share * behind.share;
            is_seen |= behind.share != T::Wide::ZERO;
            found.piece = found.piece.wrapping_mul(7).wrapping_add(1 + u64::from(behind.piece));
        }
        if is_seen {
            self.add_part(first.surface, Share::Beside, share, found);
        }
    }

    /// What is seen behind a piece of what is at the centre.
    pub(super) fn behind_part(
        &self,
        part: &Part<T::Wide>,
        first: Link<T::Wide>,
        pixel: usize,
    ) -> Option<Behind<T::Wide>> {
        if part.kind != Share::Piece {
            return None;
        }
        let alpha = self.color(part.surface, pixel).1.widen();
        behind_piece(alpha, part.radius, first.radius)
    }

    #[inline]
    fn add_part(&self, surface: Surface, kind: Share, share: T::Wide, found: &mut Parts<T::Wide>) {
        let radius = self.radius(surface);
        let position = match surface {
            Surface::BACKGROUND => self.sky_position,
            _ => self.rungs.locate(radius),
        };
        let (mut shift, mut tilt) = ([T::Wide::ZERO; 2], 0);
        if let Some(slope) = self.slope(surface) {
            let circle = self.circle(surface);
            (shift, tilt) = (tilt::shift(&circle, slope), tilt::piece(&circle, slope));
        }
        // Whether a share of 0 is listed depends on who asks.
        if share != T::Wide::ZERO {
            let place = 2 * position.rung as u64 + u64::from(self.optics.is_capped(radius));
            found.piece = found.piece.wrapping_mul(1009).wrapping_add(place ^ tilt);
        }
        found.parts.push(Part { surface, kind, share, radius, position, shift });
    }
}
