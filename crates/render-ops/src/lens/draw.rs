//! The operation: the passes over bands, with what they read and give.

use std::sync::Arc;

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_item_mut, write_each};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar};
use smallvec::SmallVec;

use super::bands::{Band, Bench, FillOutcome, Passes, add_piece};
use super::circles::Optics;
use super::disocclusion::{Disocclusion, Visible};
use super::frame::Frame;
use super::front_to_back::Gaps;
use super::inputs::{NAME, ThinLensOptions};
use super::pixel_bars::BandBars;
use super::surfaces::{Layer, View};
use crate::background::Kind;
use crate::coverage::Coverage;
use crate::defocus::{Bands, Blurs, ROWS, Strips};
use crate::error::RenderError;
use crate::scratch::Workbench;

/// Inputs: a background `[C]` or `[H, W, C]`, aperture, focus; of the visible layer colours `[N, C]`, alphas `[N]`
/// and distances `[N]`, and perhaps weights `[K]`; then colours, alphas and distances of each layer behind; then the
/// slopes `[N, 2]` of layers that have some.
pub(super) struct DrawLens {
    pub(super) visible: Arc<Coverage>,
    pub(super) hidden: SmallVec<[Arc<Coverage>; 4]>,
    /// The input of each layer's slopes, if it has some.
    pub(super) slopes: SmallVec<[Option<usize>; 4]>,
    pub(super) kind: Kind,
    pub(super) has_weights: bool,
    pub(super) far: f64,
    pub(super) frame: Frame,
    pub(super) options: ThinLensOptions,
}

/// What a backward pass reads, and memory.
#[derive(Debug)]
pub(super) struct Saved<T: Scalar> {
    blurs: Blurs,
    gaps: Gaps,
    /// Per layer the radii of its circles.
    radii: Vec<Vec<T>>,
    disocclusion: Disocclusion,
    keeps_hidden: bool,
    /// The rungs by band, and the blurred rungs by band of what is shown.
    sources: Vec<Strips<T::Wide>>,
    outcomes: Vec<FillOutcome>,
    bands: Vec<Band<T::Wide>>,
    pub(super) capped: usize,
    pub(super) piece: u64,
    benches: Workbench<Bench<T::Wide>>,
    /// Memory of a backward pass: by band of what is shown, and of the image.
    strip_bars: Vec<Strips<T::Wide>>,
    band_bars: Vec<BandBars<T::Wide>>,
}

impl<T: Scalar> Default for Saved<T> {
    fn default() -> Self {
        Self {
            blurs: Blurs::default(),
            gaps: Gaps::default(),
            radii: Vec::new(),
            disocclusion: Disocclusion::default(),
            keeps_hidden: false,
            sources: Vec::new(),
            outcomes: Vec::new(),
            bands: Vec::new(),
            capped: 0,
            piece: 0,
            benches: Workbench::default(),
            strip_bars: Vec::new(),
            band_bars: Vec::new(),
        }
    }
}

/// Layers, and their coverage behind the visible one: few.
type Layers<'a, T> = SmallVec<[Layer<'a, T>; 4]>;
type Behind<'a> = SmallVec<[&'a Coverage; 4]>;

impl DrawLens {
    /// The first input of each layer, and its coverage.
    fn layers(&self) -> impl Iterator<Item = (usize, &Coverage)> + '_ {
        let behind = 6 + usize::from(self.has_weights);
        let hidden = self.hidden.iter().enumerate();
        let hidden = hidden.map(move |(k, layer)| (behind + 3 * k, &**layer));
        std::iter::once((3, &*self.visible)).chain(hidden)
    }

    fn optics<T: Scalar>(&self, [aperture, focus]: [&[T]; 2]) -> Optics<T::Wide> {
        let [aperture, focus] = [aperture, focus].map(|number| number[0].widen());
        Optics { aperture, focus, largest: self.options.largest_radius }
    }

    /// Finds the radii of all circles; returns how many are capped.
    fn find_radii<T: Scalar>(&self, inputs: &Inputs<'_, T>, radii: &mut Vec<Vec<T>>) -> usize {
        let optics = self.optics([inputs.data(1), inputs.data(2)]);
        radii.resize_with(1 + self.hidden.len(), Vec::new);
        let cap = T::from_f64(self.options.largest_radius);
        let mut capped = 0;
        for ((first, _), radii) in self.layers().zip(radii) {
            let distances = inputs.data(first + 2);
            radii.resize(distances.len(), T::ZERO);
            write_each(radii, ENTRIES_PER_PIECE, |k| {
                T::narrow(optics.radius(distances[k].widen()).0)
            });
            // A circle may be as large as the cap by itself.
            let is_capped =
                |(radius, z): &(&T, &T)| radius.abs() >= cap && optics.radius(z.widen()).1;
            capped += radii.iter().zip(distances).filter(is_capped).count();
        }
        capped
    }

    /// Finds where hidden surfaces can be seen.
    fn find_jumps<T: Scalar>(
        &self,
        inputs: &Inputs<'_, T>,
        radii: &[Vec<T>],
        disocclusion: &mut Disocclusion,
    ) {
        let optics = self.optics([inputs.data(1), inputs.data(2)]);
        let at_centers = self.hidden.first().map(|first| {
            let input = 6 + usize::from(self.has_weights);
            (&**first, inputs.data(input + 1), &radii[1][..])
        });
        let visible = Visible {
            at_centers,
            coverage: &self.visible,
            alphas: inputs.data(4),
            radii: &radii[0],
            weights: if self.has_weights { inputs.data(6) } else { &[] },
            background: optics.radius(T::Wide::from_f64(self.far)).0.to_f64(),
        };
        disocclusion.update(&visible, self.options.iris);
    }

    /// All surfaces, of the operation's inputs.
    fn view<'a, T: Scalar>(
        &'a self,
        input: impl Fn(usize) -> &'a [T],
        saved: (&'a Blurs, &'a [Vec<T>], &'a Disocclusion, bool),
        work: impl FnOnce(&View<'_, T>),
    ) {
        let (blurs, radii, disocclusion, keeps_hidden) = saved;
        let layer = |((first, _), (radii, slopes)): ((usize, &Coverage), (&'a Vec<T>, _))| Layer {
            colors: input(first),
            alphas: input(first + 1),
            distances: input(first + 2),
            slopes: Option::map_or(slopes, &[][..], &input),
            radii,
        };
        let each = radii.iter().zip(self.slopes.iter().copied());
        let layers: Layers<'_, T> = self.layers().zip(each).map(layer).collect();
        let behind: Behind<'_> = self.hidden.iter().map(|layer| &**layer).collect();
        let optics = self.optics([input(1), input(2)]);
        let reference = self.reference(input(0));
        let sky = optics.circle(T::Wide::from_f64(self.far));
        work(&View {
            channels: reference.len(),
            layers: &layers,
            weights: if self.has_weights { input(6) } else { &[] },
            visible: &self.visible,
            behind: &behind,
            rungs: &blurs.rungs,
            disocclusion,
            optics,
            sky,
            sky_position: blurs.rungs.locate(sky.radius),
            background: input(0),
            kind: self.kind,
            reference: &reference,
            keeps_hidden,
        });
    }

    fn channels(&self, background: usize) -> usize {
        match self.kind {
            Kind::Color => background,
            Kind::Image => background / self.frame.size.pixels(),
        }
    }

    /// The colour that rungs hold the difference to.
    fn reference<T: Scalar>(&self, background: &[T]) -> SmallVec<[T; 4]> {
        match self.kind {
            Kind::Color => SmallVec::from_slice(background),
            Kind::Image => SmallVec::from_elem(T::ZERO, self.channels(background.len())),
        }
    }

    /// Adds the gradients of all layers.
    fn give_layers<T: Scalar>(
        &self,
        bands: &[BandBars<T::Wide>],
        channels: usize,
        gradients: &mut Accumulators<'_, T>,
    ) {
        for (layer, (first, coverage)) in self.layers().enumerate() {
            for (list, width) in [channels, 1, 1, 2].into_iter().enumerate() {
                let input = if list == 3 { self.slopes[layer] } else { Some(first + list) };
                let Some(bar) = input.and_then(|input| gradients.get(input)) else { continue };
                let entries = bar.entries();
                let centers = &mut entries[..coverage.centers() * width];
                coverage.centers.for_each_band_mut(width, centers, |slots, first, entries| {
                    for run in coverage.centers.in_slots(slots) {
                        let band = run.pixel as usize / self.frame.size.width / ROWS;
                        let start = band * ROWS * self.frame.size.width;
                        let from = bands[band].layers[layer].run_bars(list, width, start, run);
                        let to = &mut entries[(run.fragment as usize - first) * width..];
                        for (to, &from) in to.iter_mut().zip(from.unwrap_or_default()) {
                            *to += T::narrow(from);
                        }
                    }
                });
                if layer == 0 {
                    let start = [0, channels, channels + 1, channels + 2][list];
                    add_pieces(bands, [channels + 4, start, width], entries);
                }
            }
        }
        if self.has_weights
            && let Some(bar) = gradients.get(6)
        {
            let entries = bar.entries();
            for &(piece, bar) in bands.iter().flat_map(|band| &band.weights) {
                entries[piece as usize - self.visible.centers()] += T::narrow(bar);
            }
        }
    }

    /// Adds the gradients of the background, of aperture and of focus.
    fn give_optics<T: Scalar>(
        &self,
        bands: &[BandBars<T::Wide>],
        channels: usize,
        gradients: &mut Accumulators<'_, T>,
    ) {
        if let Some(bar) = gradients.get(0) {
            let entries = bar.entries();
            let row = ROWS * self.frame.size.width * channels;
            match self.kind {
                Kind::Color => {
                    for (channel, to) in entries.iter_mut().enumerate() {
                        let sum: T::Wide = bands.iter().map(|band| band.background[channel]).sum();
                        *to += T::narrow(sum);
                    }
                }
                Kind::Image => {
                    for (to, band) in entries.chunks_mut(row).zip(bands) {
                        let pairs = to.iter_mut().zip(&band.background);
                        pairs.for_each(|(to, &bar)| *to += T::narrow(bar));
                    }
                }
            }
        }
        for k in 0..2 {
            if let Some(bar) = gradients.get(1 + k) {
                let sum: T::Wide = bands.iter().map(|band| band.optics[k]).sum();
                bar.add_each(|_| T::narrow(sum));
            }
        }
    }
}

/// Adds a part of the gradients of visible pieces, `width` numbers of each from `start` on.
fn add_pieces<T: Scalar>(
    bands: &[BandBars<T::Wide>],
    [count, start, width]: [usize; 3],
    entries: &mut [T],
) {
    for band in bands {
        for (&piece, bars) in band.pieces.iter().zip(band.piece_bars.chunks_exact(count)) {
            let to = &mut entries[piece as usize * width..][..width];
            to.iter_mut().zip(&bars[start..]).for_each(|(to, &bar)| *to += T::narrow(bar));
        }
    }
}

impl<T: Scalar> Op<T> for DrawLens {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Saved<T>,
    ) -> Result<(), RenderError> {
        let Saved { blurs, gaps, radii, disocclusion, sources, outcomes, bands, benches, .. } =
            saved;
        saved.capped = self.find_radii(inputs, radii);
        saved.keeps_hidden = self.layers().any(|(first, _)| inputs.needs(first + 1));
        if blurs.reach(self.options.largest_radius, self.options.iris) {
            gaps.update(&blurs.rungs);
        }
        self.find_jumps(inputs, radii, disocclusion);
        let (frame, shown) = (self.frame, self.frame.shown_size());
        let count = frame.size.height.div_ceil(ROWS);
        sources.resize_with(count, Strips::default);
        outcomes.resize_with(count, FillOutcome::default);
        let passes = Passes { blurs, gaps, frame, benches };
        self.view(
            |k| inputs.data(k),
            (blurs, radii, disocclusion, saved.keeps_hidden),
            |view| {
                passes.fill_rungs(view, sources, outcomes);
            },
        );
        if let Some([layer, pixel]) = outcomes.iter().find_map(|outcome| outcome.fault) {
            return Err(RenderError::LayerPixel { layer, pixel });
        }
        for strip in sources.iter().flat_map(Strips::as_slice) {
            blurs.use_rung(strip.rung);
        }
        bands.resize_with(shown.height.div_ceil(ROWS), Band::default);
        let channels = self.channels(inputs.data(0).len());
        let out = outputs.push([shown.height, shown.width, channels]);
        let source = Bands { bands: sources, first: 0 };
        let reference = self.reference(inputs.data(0));
        let tells_piece = self.options.tells_piece;
        let passes = Passes { blurs, gaps, frame, benches };
        passes.see(source, &reference, tells_piece, bands, out);
        saved.piece = 0;
        if tells_piece {
            let pieces = outcomes.iter().map(|outcome| outcome.piece);
            let pieces = pieces.chain(bands.iter().map(|band| band.piece));
            pieces.for_each(|piece| add_piece(&mut saved.piece, piece));
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        (0..inputs.len()).fold(Keep::NOTHING, Keep::input)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Saved<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Saved { blurs, gaps, radii, disocclusion, sources, bands, benches, .. } = saved;
        let (strip_bars, band_bars) = (&mut saved.strip_bars, &mut saved.band_bars);
        strip_bars.resize_with(bands.len(), Strips::default);
        let passes = Passes { blurs, gaps, frame: self.frame, benches };
        passes.pull_back_seen(bands, kept.only_upstream(), strip_bars);
        band_bars.resize_with(sources.len(), BandBars::default);
        let blurs = &*blurs;
        self.view(
            |k| kept.input(k),
            (blurs, radii, disocclusion, saved.keeps_hidden),
            |view| {
                for_each_item_mut(band_bars, |band, found| {
                    passes.pull_back_rungs(view, &sources[band], strip_bars, band, found);
                });
            },
        );
        let channels = self.channels(kept.input(0).len());
        self.give_optics(band_bars, channels, gradients);
        self.give_layers(band_bars, channels, gradients);
    }

    fn saved_bytes(&self, saved: &Saved<T>) -> usize {
        let blurred = saved.bands.iter().map(|band| band.blurred.bytes());
        let strips: usize = saved.sources.iter().map(Strips::bytes).chain(blurred).sum();
        strips + saved.radii.iter().map(|radii| size_of_val(&radii[..])).sum::<usize>()
    }
}
