//! The passes over bands of rows: from surfaces to rungs, blurs, and what is seen; and back.
//!
//! A pass works on all bands at the same time, and each band writes its own memory. A gradient's fragment is of
//! one pixel, so of one band; sums over all pixels are taken in the order of the bands. So the bits are the same
//! for any number of threads.
//!
//! # Backward
//! With `E = (C_bar, A_bar)` of the rungs k and k + 1 at its pixel, blurred, a surface of colour times alpha c,
//! of alpha a, and with the share p of the pixel has with `B = (1 - t) E_k + t E_(k+1)`:
//! `(c, a)_bar = p B`, `p_bar = B . (c, a)`, `s_bar = p (E_(k+1) - E_k) . (c, a) dt/ds`. Where a surface is moved
//! (`tilt`), E is the mean of those at the pixels that share it.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::{for_each_item_mut, for_each_two_pieces_mut};

use super::frame::Frame;
use super::front_to_back::{Gaps, LensState, common};
use super::hiding::LinkBar;
use super::pixel_bars::{BandBars, RungBars};
use super::spans::{Between, Lines};
use super::surfaces::{Part, Parts, Row, Shown, Span, View};
use super::tilt;
use crate::defocus::{Bands, Blurs, Memory, ROWS, Strip, Strips, halved, mean_weight};
use crate::scratch::Workbench;
use crate::size::Size;

/// What is found while a band of the image is filled, beside what its surfaces put on rungs.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct FillOutcome {
    /// Tells on which smooth piece all of it lies.
    pub(super) piece: u64,
    /// A layer and a pixel that it covers, and the layer before does not.
    pub(super) fault: Option<[usize; 2]>,
}

/// A band of the picture: its blurred rungs, where they are seen, and which smooth piece they lie on.
#[derive(Debug, Default)]
pub(super) struct Band<S> {
    pub(super) blurred: Strips<S>,
    pub(super) piece: u64,
}

/// Memory for the work on a band.
#[derive(Debug, Default)]
pub(super) struct Bench<S> {
    row: Row,
    parts: Parts<S>,
    lines: Lines<S>,
    link_bars: Vec<LinkBar<S>>,
    blur: Memory<S>,
    /// The band of the picture, or its gradient.
    picture: Vec<S>,
    state: LensState<S>,
    /// The gradients of blurred rungs, or of what surfaces put on rungs.
    bars: Strips<S>,
}

/// Adds to what tells pieces apart.
pub(super) fn add_piece(sum: &mut u64, piece: u64) {
    *sum = (*sum ^ piece).wrapping_mul(0x0100_0000_01b3);
}

/// Adds to a rung a share of what a pixel shows: its difference to the reference of the same alpha; and the alpha.
#[inline]
fn add_to_rung<T: Scalar>(
    view: &View<'_, T>,
    frame: Frame,
    halvings: usize,
    [row, column]: [usize; 2],
    part: &Part<T::Wide>,
    weight: T::Wide,
    strip: &mut Strip<T::Wide>,
) {
    let (color, alpha) = view.color(part.surface, row * frame.size.width + column);
    let mean = mean_weight(frame.size, halvings, [row, column]);
    let weight = weight * part.share * T::Wide::from_f64(mean);
    let alpha = alpha.widen();
    let mut add = |[row, column]: [usize; 2], weight: T::Wide| {
        strip.hold(column);
        let (mut offset, plane) = (strip.offset(row, column), strip.plane());
        for (&color, &reference) in color.iter().zip(view.reference) {
            strip.values[offset] += weight * (color.widen() - alpha * reference.widen());
            offset += plane;
        }
        strip.values[offset] += weight * alpha;
    };
    if !part.is_moved() {
        return add([row >> halvings, column >> halvings], weight);
    }
    let small = halved(frame.size, halvings);
    let [columns, rows] = tilt::taps(small, halvings, [row, column], part.shift);
    for (row, by_row, _) in rows {
        for (column, by_column, _) in columns {
            add([row, column], weight * by_row * by_column);
        }
    }
}

/// The passes, and memory for them.
#[derive(Debug)]
pub(super) struct Passes<'a, T: Scalar> {
    pub(super) blurs: &'a Blurs,
    pub(super) gaps: &'a Gaps,
    pub(super) frame: Frame,
    pub(super) benches: &'a Workbench<Bench<T::Wide>>,
}

impl<T: Scalar> Passes<'_, T> {
    /// Shares the surfaces among the rungs.
    pub(super) fn fill_rungs(
        &self,
        view: &View<'_, T>,
        bands: &mut [Strips<T::Wide>],
        outcomes: &mut [FillOutcome],
    ) {
        let Self { blurs, frame, benches, .. } = *self;
        let halvings = &blurs.halvings;
        for_each_two_pieces_mut(bands, outcomes, [1, 1], |band, strips, outcome| {
            let strips = &mut strips[0];
            strips.clear();
            outcome[0] = FillOutcome::default();
            let FillOutcome { piece, fault } = &mut outcome[0];
            benches.with(|bench| {
                let Bench { row, parts, lines, .. } = bench;
                let rows = frame.rows(band);
                *fault = view.for_each_shown(rows.clone(), row, parts, |shown| match shown {
                    Shown::Span(span) => {
                        crate::dispatch::dispatch_256::<T, _>(
                            #[inline(always)]
                            || {
                                // Moved, so that the closure can run only once and is inlined here.
                                let span = span;
                                add_piece(piece, self.fill_span(view, &rows, &span, lines, strips));
                            },
                        );
                    }
                    Shown::Pixel(place, parts) => {
                        add_piece(piece, parts.piece);
                        for part in &parts.parts {
                            for (rung, weight) in part.position.rungs().into_iter().flatten() {
                                let strip = self.strip(view, &rows, rung, strips);
                                add_to_rung(
                                    view,
                                    frame,
                                    halvings[rung],
                                    place,
                                    part,
                                    weight,
                                    strip,
                                );
                            }
                        }
                    }
                });
            });
        });
    }

    /// Shares a span; returns a number that tells on which smooth piece it lies.
    #[inline(always)]
    fn fill_span(
        &self,
        view: &View<'_, T>,
        rows: &Range<usize>,
        span: &Span,
        lines: &mut Lines<T::Wide>,
        strips: &mut Strips<T::Wide>,
    ) -> u64 {
        let mut piece = 0;
        span.for_each_part(view, |span, between| {
            let Between { rung, is_capped, .. } = between;
            lines.read(view, span, rung);
            for is_next in [false, true] {
                if is_next && !between.has_next {
                    continue;
                }
                let rung = rung + usize::from(is_next);
                let strip = self.strip(view, rows, rung, strips);
                lines.add_to(self.frame.size, self.blurs.halvings[rung], span, is_next, strip);
            }
            add_piece(&mut piece, 2 * rung as u64 + u64::from(is_capped));
            add_piece(&mut piece, span.columns.end as u64);
        });
        piece
    }

    /// The strip of a rung in a band of some rows, made as it is used.
    fn strip<'s>(
        &self,
        view: &View<'_, T>,
        rows: &Range<usize>,
        rung: usize,
        strips: &'s mut Strips<T::Wide>,
    ) -> &'s mut Strip<T::Wide> {
        let index = strips.index(rung).unwrap_or_else(|| {
            let halvings = self.blurs.halvings[rung];
            let size = halved(self.frame.size, halvings);
            let ends = [rows.start >> halvings, rows.end.div_ceil(1 << halvings)];
            let first = ends[0].saturating_sub(view.reach());
            let end = (ends[1] + view.reach()).min(size.height);
            let strip = strips.push(rung, view.channels + 1, [first..end, 0..size.width]);
            strip.held = 0..0;
            strips.as_slice().len() - 1
        });
        &mut strips.as_mut_slice()[index]
    }

    /// Blurs the rungs, as far as something is seen of them, and puts them together in `out`, the picture
    /// without its margin.
    pub(super) fn see(
        &self,
        source: Bands<'_, T::Wide>,
        reference: &[T],
        tells_piece: bool,
        bands: &mut [Band<T::Wide>],
        out: &mut [T],
    ) {
        let Self { blurs, gaps, frame, benches } = *self;
        let channels = reference.len();
        let row = frame.shown_size().width * channels;
        for_each_two_pieces_mut(bands, out, [1, ROWS * row], |band, own, out| {
            let (own, part) = (&mut own[0], frame.shown(band));
            own.blurred.clear();
            benches.with(|bench| {
                let Bench { blur: memory, picture, state, .. } = bench;
                picture.clear();
                picture.resize(out.len(), T::Wide::ZERO);
                state.begin(&part);
                for rung in 0..blurs.rungs.count() {
                    let Some([blur, _]) = blurs.blur(rung, frame.size) else { continue };
                    let in_sight = blur.columns_in_sight(source, &part[0]);
                    let columns = common(&common(&in_sight, &part[1]), &state.unfilled());
                    if columns.is_empty() {
                        continue;
                    }
                    let target = [part[0].clone(), columns];
                    let strip = own.blurred.push(rung, channels + 1, target.clone());
                    let plane = strip.plane();
                    for (channel, out) in strip.values.chunks_exact_mut(plane).enumerate() {
                        blur.apply(source, channel, &target, memory, out);
                    }
                    state.add(own.blurred.as_slice(), gaps, channels, picture);
                }
                let pixels = picture.chunks_exact(channels).zip(&state.total);
                for (out, (picture, &total)) in out.chunks_exact_mut(channels).zip(pixels) {
                    // The background, where nothing at all is seen.
                    let (one, zero) = (T::Wide::ONE, T::Wide::ZERO);
                    let scale = if total > zero { one / total } else { zero };
                    for ((out, &sum), &reference) in out.iter_mut().zip(picture).zip(reference) {
                        *out = T::narrow(reference.widen() + sum * scale);
                    }
                }
                own.piece = match tells_piece {
                    true => state.piece(own.blurred.as_slice(), gaps, channels),
                    false => 0,
                };
            });
        });
    }

    /// The gradients of the rungs at their own sizes, before their blurs, of the picture's gradients `out_bar`.
    pub(super) fn pull_back_seen(
        &self,
        bands: &[Band<T::Wide>],
        out_bar: &[T],
        bars: &mut [Strips<T::Wide>],
    ) {
        let Self { blurs, gaps, frame, benches } = *self;
        let Size { width, height } = frame.shown_size();
        let row = out_bar.len() / height;
        let channels = row / width;
        for_each_item_mut(bars, |band, bars| {
            bars.clear();
            let blurred = bands[band].blurred.as_slice();
            let part = frame.shown(band);
            let out_bar = &out_bar[(part[0].start - frame.margin) * row..][..part[0].len() * row];
            benches.with(|bench| {
                let Bench { blur: memory, state, picture, bars: shown_bars, .. } = bench;
                picture.clear();
                picture.extend(out_bar.iter().map(|bar| bar.widen()));
                shown_bars.clear();
                for strip in blurred {
                    let place = [strip.rows.clone(), strip.columns.clone()];
                    shown_bars.push(strip.rung, channels + 1, place);
                }
                state.begin(&part);
                state.pull_back(blurred, gaps, picture, shown_bars.as_mut_slice());
                for from in shown_bars.as_slice() {
                    let Some([blur, _]) = blurs.blur(from.rung, frame.size) else { continue };
                    let place = [from.rows.clone(), from.columns.clone()];
                    let to = bars.push(from.rung, channels + 1, blur.small_part(&place));
                    let (plane, small_plane) = (from.plane(), to.plane());
                    let pairs = from.values.chunks_exact(plane);
                    for (from, to) in pairs.zip(to.values.chunks_exact_mut(small_plane)) {
                        blur.pull_back_size(from, &place, memory, to);
                    }
                }
            });
        });
    }

    /// The gradients of the surfaces in a band, of those of the rungs.
    pub(super) fn pull_back_rungs(
        &self,
        view: &View<'_, T>,
        source: &Strips<T::Wide>,
        bars: &[Strips<T::Wide>],
        band: usize,
        found: &mut BandBars<T::Wide>,
    ) {
        let Self { blurs, frame, benches, .. } = *self;
        let rows = frame.rows(band);
        found.clear(view, rows.len() * frame.size.width);
        benches.with(|bench| {
            let Bench { row, parts, lines, link_bars, blur: memory, bars: at_rungs, .. } = bench;
            at_rungs.clear();
            // Only where a surface asks.
            for strip in source.as_slice().iter().filter(|strip| !strip.held.is_empty()) {
                let Some([_, adjoint]) = blurs.blur(strip.rung, frame.size) else { continue };
                let place = [strip.rows.clone(), strip.held.clone()];
                let bars = Bands { bands: bars, first: frame.margin };
                if adjoint.is_out_of_sight(bars, &place[0]) {
                    continue;
                }
                let to = at_rungs.push(strip.rung, view.channels + 1, place.clone());
                let plane = to.plane();
                for (channel, out) in to.values.chunks_exact_mut(plane).enumerate() {
                    adjoint.convolve(bars, channel, &place, memory, out);
                }
            }
            let rungs = RungBars { blurs, frame, at_rungs };
            view.for_each_shown(rows, row, parts, |shown| match shown {
                Shown::Span(span) => crate::dispatch::dispatch_256::<T, _>(
                    #[inline(always)]
                    || {
                        // Moved, so that the closure can run only once and is inlined here.
                        let span = span;
                        found.add_span(rungs, view, &span, lines);
                    },
                ),
                Shown::Pixel(place, parts) => {
                    found.add_pixel(rungs, view, place, parts, link_bars);
                }
            });
        });
    }
}
