//! A lens that knows what hides what.
//!
//! # Forward
//! What a lens sees is an integral over its points. Each surface that a pixel shows, and those close to its
//! outlines that it hides, has a circle of confusion (`circles`). By it the surface is shared among a few rungs,
//! blurs of fixed radii (`rungs`, `surfaces`, `hiding`). Each rung is blurred by a disc, its colours and its alpha
//! (`disc`), and the blurred rungs are put together from front to back (`front_to_back`). Each file has its
//! formulas, and `bands` has the passes over the image.
//!
//! # Backward
//! The same passes from last to first: each file has its own step back beside its step forward.
//!
//! # Where it is not smooth
//! Where a circle passes a rung, where what is left of the lens decides what is seen, where a circle reaches its
//! cap, and where the visible surface changes. The value steps in none but the last.
//!
//! # Memory
//! A band of 16 rows holds each rung that something in it lies on, over the image's width, and each blurred rung
//! that is seen in it, over the columns that it reaches; a backward pass holds the latter twice. So a picture of
//! two planes holds four rungs, and a floor holds little more than two, cut at other rows.
//!
//! # Limits
//! What no ray through the middle of the lens meets is not known: the far side of a ball's rim, and surfaces
//! behind those of the last layer. In focus a surface has no gradient by its distance: its circle is at its
//! minimum.
//!
//! # Source
//! Potmesil and Chakravarty, *Synthetic image generation with a lens and aperture camera model*, ACM TOG 1(2),
//! 1982, for the circle of confusion. The rungs, and how they hide each other, are our own: an integral over the
//! lens is what they are measured against.

mod bands;
mod circles;
mod disc;
mod front_to_back;
mod hiding;
mod rungs;
mod strips;
mod surfaces;

use std::sync::Arc;

use bokashi_core::parallel::for_each_item_mut;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Tape, TensorError, Var};

use self::bands::{Band, BandBars, Bench, Blurs, Frame, Told, bytes_of, fill_rungs};
use self::circles::{Circle, Optics};
use self::disc::Disc;
use self::front_to_back::Gaps;
use self::rungs::Rungs;
use self::strips::{ROWS, Strips};
use self::surfaces::{Surfaces, View};
use crate::background::{Background, Kind};
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::fragments::Fragments;
use crate::picture::{Composite, checked_channels};
use crate::scratch::Workbench;

const NAME: &str = "lens_picture";

/// A thin lens, as variables.
#[derive(Debug, Clone, Copy)]
pub struct ThinLens<'t, T: Scalar> {
    /// The radius, in pixels, of the circle of confusion at infinity: a single number. It is twice the standard
    /// deviation that [`Lens::aperture`](crate::Lens) is.
    pub aperture: Var<'t, T>,
    /// The distance at which the picture is sharp, in units of the scene. A single number.
    pub focus: Var<'t, T>,
}

impl<'t, T: Scalar> ThinLens<'t, T> {
    /// A lens that is as wide however it is focused: of a radius in units of the scene, behind which the image
    /// lies at the focal length of its camera, in pixels. Its circles at infinity have the radius `focal_length
    /// radius / focus`, so that they change with the focus. All three are single numbers.
    ///
    /// # Errors
    /// `TensorError::ForeignVariable` for variables of several tapes, and what the tape refuses of their shapes.
    pub fn from_radius(
        radius: Var<'t, T>,
        focal_length: Var<'t, T>,
        focus: Var<'t, T>,
    ) -> Result<Self, RenderError> {
        let aperture = focal_length.try_mul(radius)?.try_div(focus)?;
        Ok(Self { aperture, focus })
    }
}

/// How a lens draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThinLensOptions {
    /// How many pixels of the fragments' image are cut off at each side. What lies beyond the picture is blurred
    /// into it, as far as the largest circle of confusion reaches: without that margin the picture is mirrored
    /// at its border.
    pub margin: usize,
    /// The cap on the radius of a circle of confusion, in pixels: without it, it would be infinite at distance 0.
    pub largest_radius: f64,
}

impl Default for ThinLensOptions {
    /// No margin, and circles of at most 64 pixels.
    fn default() -> Self {
        Self { margin: 0, largest_radius: 64.0 }
    }
}

/// What a lens sees of one layer in depth.
#[derive(Debug, Clone, Copy)]
pub struct LensLayer<'a, 't, T: Scalar> {
    /// The layer's fragments, of an image as large as the picture and its margin.
    pub fragments: &'a Fragments<'t, T>,
    /// Colours times their alpha, `[N, C]`.
    pub premultiplied: Var<'t, T>,
    /// How much of what lies behind is hidden, from 0 to 1: `[N]`.
    pub alpha: Var<'t, T>,
    /// Distances along the view axis, `[N]`, from 0 to infinity: those of [`eye_depth`](crate::eye_depth()).
    pub distance: Var<'t, T>,
}

/// What [`lens_picture`] gives.
#[derive(Debug, Clone, Copy)]
pub struct LensPicture<'t, T: Scalar> {
    /// The image `[H, W, C]`, without the margin.
    pub image: Var<'t, T>,
    /// How many fragments were so far out of focus that their circle was capped.
    pub capped: usize,
    /// Tells on which smooth piece the inputs lie: between inputs for which it differs there is a kink.
    #[doc(hidden)]
    pub piece: u64,
}

/// The picture that a lens sees of surfaces one behind another, before a background that is `far` away.
///
/// `visible` are the fragments of any sampling; with exact coverage, outlines have their gradients. `behind` are
/// the layers at pixel centres that [`depth_layers`](crate::depth_layers()) found of the same mesh, the nearest
/// first. The first of these says what hides what, and its colours are not asked for; the others are seen
/// beside the outlines of what hides them. Two hidden layers are enough: leave the mesh's back faces out
/// ([`Cull`](crate::Cull)), else its far side counts as one. Without a layer `behind`, nothing but the background
/// is seen behind what is visible.
///
/// Colours, alphas, distances, weights of pieces, the background and both numbers of the lens can have a
/// gradient. For a picture that comes with one depth, and nothing behind it,
/// [`depth_of_field`](crate::depth_of_field()) costs less.
///
/// An aperture of 0 before surfaces whose alphas are 1, and not learnt, is [`composite`](crate::composite()).
///
/// # Errors
/// - [`RenderError::Shape`] unless the colours of each layer are `[N, C]`, C > 0, its alphas and distances `[N]`,
///   the background has as many channels, aperture and focus are single numbers; and for fragments that are
///   not whole.
/// - [`RenderError::ExactLayers`] for a layer of exact coverage behind, [`RenderError::LayerSize`] for layers of
///   several sizes, [`RenderError::LayerPixel`] where a layer covers a pixel that the layer before does not.
/// - `TensorError::Value` for a distance that is negative or NaN, an aperture that is negative or not finite, a
///   focus that is not finite and positive, a largest radius that is not between 0 and 1024, a margin that leaves
///   nothing of the picture.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn lens_picture<'t, T: Scalar>(
    visible: LensLayer<'_, 't, T>,
    behind: &[LensLayer<'_, 't, T>],
    background: Background<'t, T>,
    far: f64,
    lens: ThinLens<'t, T>,
    options: &ThinLensOptions,
) -> Result<LensPicture<'t, T>, RenderError> {
    let tape = visible.premultiplied.tape();
    let own = visible.fragments.checked_coverage(NAME, tape)?;
    own.check_shaded(NAME)?;
    let size = own.size();
    let channels = checked_channels(NAME, visible.premultiplied, own.count())?;
    check_numbers(tape, lens, far, options)?;
    let least = size.width.min(size.height);
    if 2 * options.margin >= least {
        let rule = format!("a margin of less than half of {least} pixels");
        return Err(RenderError::value(NAME, rule, options.margin as f64));
    }
    visible.check(own.count(), channels)?;
    let backdrop = background.behind(NAME, tape, size, channels)?;
    let mut inputs = vec![backdrop.values, lens.aperture, lens.focus];
    inputs.extend([visible.premultiplied, visible.alpha, visible.distance]);
    inputs.extend(visible.fragments.weight);
    let mut hidden = Vec::with_capacity(behind.len());
    for layer in behind {
        let coverage = layer.fragments.checked_coverage(NAME, tape)?;
        if coverage.is_exact() {
            return Err(RenderError::ExactLayers { operation: NAME });
        }
        if coverage.size() != size {
            return Err(RenderError::LayerSize { expected: size, given: coverage.size() });
        }
        layer.check(coverage.count(), channels)?;
        inputs.extend([layer.premultiplied, layer.alpha, layer.distance]);
        hidden.push(coverage);
    }
    let hides = std::iter::once(&visible).chain(behind.first());
    if lens.aperture.item() == T::ZERO && hides.clone().all(LensLayer::is_opaque) {
        let values = visible.premultiplied;
        let image = Composite::from_values(values, visible.fragments, background)?.image()?;
        let margin = options.margin;
        let image = image.slice(0, margin..size.height - margin)?;
        let image = image.slice(1, margin..size.width - margin)?;
        return Ok(LensPicture { image, capped: 0, piece: 0 });
    }
    let has_weights = visible.fragments.weight.is_some();
    let frame = Frame { size, margin: options.margin };
    let largest = options.largest_radius;
    let op =
        DrawLens { visible: own, hidden, kind: backdrop.kind, has_weights, far, frame, largest };
    let look = |saved: &Saved<T>| [saved.capped as u64, saved.piece];
    let (outputs, [capped, piece]) = tape.record_with(op, &inputs, look)?;
    Ok(LensPicture { image: outputs[0], capped: capped as usize, piece })
}

/// # Errors
/// As [`lens_picture`].
fn check_numbers<T: Scalar>(
    tape: &Tape<T>,
    lens: ThinLens<'_, T>,
    far: f64,
    options: &ThinLensOptions,
) -> Result<(), RenderError> {
    for (number, what) in [(lens.aperture, "aperture"), (lens.focus, "focus")] {
        if !std::ptr::eq(number.tape(), tape) {
            return Err(TensorError::ForeignVariable { operation: NAME }.into());
        }
        if number.shape().size() != 1 {
            let rule = format!("a single number for the {what}");
            return Err(RenderError::shape(NAME, rule, &number.shape()));
        }
    }
    let [aperture, focus] = [lens.aperture, lens.focus].map(|number| number.item().to_f64());
    let largest = options.largest_radius;
    let rules = [
        (aperture >= 0.0 && aperture.is_finite(), aperture, "a finite aperture of at least 0"),
        (focus > 0.0 && focus.is_finite(), focus, "a finite and positive focus"),
        (far > 0.0, far, "a background at a distance above 0"),
        ((0.0..=1024.0).contains(&largest), largest, "a largest radius from 0 to 1024 pixels"),
    ];
    match rules.into_iter().find(|(holds, ..)| !holds) {
        Some((_, value, rule)) => Err(RenderError::value(NAME, rule, value)),
        None => Ok(()),
    }
}

impl<'t, T: Scalar> LensLayer<'_, 't, T> {
    /// # Errors
    /// As [`lens_picture`].
    fn check(&self, count: usize, channels: usize) -> Result<(), RenderError> {
        let tape = self.premultiplied.tape();
        let expected = [
            (self.premultiplied, vec![count, channels], "values"),
            (self.alpha, vec![count], "alphas"),
            (self.distance, vec![count], "distances"),
        ];
        for (variable, shape, what) in expected {
            if !std::ptr::eq(variable.tape(), tape) {
                return Err(TensorError::ForeignVariable { operation: NAME }.into());
            }
            if *variable.shape() != shape[..] {
                let rule = format!("{what} of shape {shape:?}");
                return Err(RenderError::shape(NAME, rule, &variable.shape()));
            }
        }
        let distances = self.distance.value();
        let is_distance = |z: &T| *z >= T::ZERO;
        match distances.data().iter().position(|z| !is_distance(z)) {
            Some(row) => {
                let value = distances.data()[row].to_f64();
                let rule = format!("distances from 0 up, in row {row} too");
                Err(RenderError::value(NAME, rule, value))
            }
            None => Ok(()),
        }
    }

    /// Whether it hides all that lies behind it, and will.
    fn is_opaque(&self) -> bool {
        let alpha = self.alpha;
        !alpha.needs_gradient() && alpha.value().data().iter().all(|&alpha| alpha == T::ONE)
    }
}

/// Inputs: a background `[C]` or `[H, W, C]`, aperture, focus; of the visible layer colours `[N, C]`, alphas `[N]`
/// and distances `[N]`, and perhaps weights `[K]`; then colours, alphas and distances of each layer behind.
struct DrawLens {
    visible: Arc<Coverage>,
    hidden: Vec<Arc<Coverage>>,
    kind: Kind,
    has_weights: bool,
    far: f64,
    frame: Frame,
    largest: f64,
}

/// What a backward pass reads, and memory.
#[derive(Debug)]
struct Saved<T: Scalar> {
    surfaces: Surfaces<T>,
    rungs: Rungs,
    gaps: Gaps,
    /// By how many rungs they lie from the picture itself; made once they are used.
    discs: Vec<Disc>,
    /// The rungs by band, and the blurred rungs by band of what is shown.
    sources: Vec<Strips<T>>,
    told: Vec<Told>,
    bands: Vec<Band<T>>,
    capped: usize,
    piece: u64,
    benches: Workbench<Bench<T>>,
    bars: SavedBars<T>,
}

/// Memory of a backward pass.
#[derive(Debug)]
struct SavedBars<T: Scalar> {
    /// Of the blurred rungs.
    strips: Vec<Strips<T>>,
    bands: Vec<BandBars<T>>,
    colors: Vec<T>,
    alphas: Vec<T>,
    distances: Vec<T>,
    weights: Vec<T>,
}

impl<T: Scalar> Default for Saved<T> {
    fn default() -> Self {
        Self {
            surfaces: Surfaces::default(),
            rungs: Rungs::default(),
            gaps: Gaps::default(),
            discs: Vec::new(),
            sources: Vec::new(),
            told: Vec::new(),
            bands: Vec::new(),
            capped: 0,
            piece: 0,
            benches: Workbench::default(),
            bars: SavedBars {
                strips: Vec::new(),
                bands: Vec::new(),
                colors: Vec::new(),
                alphas: Vec::new(),
                distances: Vec::new(),
                weights: Vec::new(),
            },
        }
    }
}

/// Bands whose gradients wait at the same time to be added up.
const BANDS_AT_ONCE: usize = 16;

impl DrawLens {
    /// The first input of each layer, and how many fragments it has.
    fn layers(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let behind = 6 + usize::from(self.has_weights);
        let hidden = self.hidden.iter().enumerate();
        let hidden = hidden.map(move |(k, layer)| (behind + 3 * k, layer.count()));
        std::iter::once((3, self.visible.count())).chain(hidden)
    }

    fn view<'a, T: Scalar>(
        &'a self,
        surfaces: &'a Surfaces<T>,
        rungs: &'a Rungs,
        [background, aperture, focus]: [&'a [T]; 3],
    ) -> View<'a, T> {
        let (aperture, focus) = (aperture[0].widen(), focus[0].widen());
        let optics = Optics { aperture, focus, largest: self.largest };
        let sky = optics.circle(T::Wide::from_f64(self.far));
        let (visible, kind) = (&*self.visible, self.kind);
        View { surfaces, visible, rungs, optics, sky, background, kind }
    }

    /// Copies the layers.
    ///
    /// # Errors
    /// [`RenderError::LayerPixel`] where a layer covers a pixel that the layer before does not.
    fn gather<T: Scalar>(
        &self,
        inputs: &Inputs<'_, T>,
        surfaces: &mut Surfaces<T>,
    ) -> Result<(), RenderError> {
        surfaces.clear(inputs.shape(3)[1]);
        for (first, _) in self.layers() {
            surfaces.add([0, 1, 2].map(|k| inputs.data(first + k)));
        }
        if self.has_weights {
            surfaces.weights.extend_from_slice(inputs.data(6));
        }
        surfaces.keeps_hidden = self.layers().any(|(first, _)| inputs.needs(first + 1));
        let hidden = self.hidden.iter().map(|layer| &**layer);
        match surfaces.find(&self.visible, hidden) {
            Some([layer, pixel]) => Err(RenderError::LayerPixel { layer, pixel }),
            None => Ok(()),
        }
    }
}

impl DrawLens {
    /// Adds the gradients of all layers.
    fn give_layers<T: Scalar>(
        &self,
        bars: &SavedBars<T>,
        channels: usize,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let mut start = 0;
        for (first, count) in self.layers() {
            let own = start..start + count;
            start += count;
            if let Some(bar) = gradients.get(first) {
                bar.add(&bars.colors[own.start * channels..own.end * channels]);
            }
            if let Some(bar) = gradients.get(first + 1) {
                bar.add(&bars.alphas[own.clone()]);
            }
            if let Some(bar) = gradients.get(first + 2) {
                bar.add(&bars.distances[own]);
            }
        }
        if self.has_weights
            && let Some(bar) = gradients.get(6)
        {
            bar.add(&bars.weights);
        }
    }
}

/// Counts the fragments whose circle is capped.
fn count_capped<T: Scalar>(distances: &[T], optics: &Optics<T::Wide>) -> usize {
    let circles = distances.iter().map(|&z| optics.circle(z.widen()));
    circles.filter(|circle: &Circle<T::Wide>| circle.is_capped).count()
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
        self.gather(inputs, &mut saved.surfaces)?;
        let Saved { surfaces, rungs, gaps, discs, sources, told, bands, benches, .. } = saved;
        rungs.reach(self.largest);
        gaps.between(rungs);
        let view = self.view(surfaces, rungs, [0, 1, 2].map(|k| inputs.data(k)));
        let count = self.frame.size.height.div_ceil(ROWS);
        sources.resize_with(count, Strips::default);
        told.resize_with(count, Told::default);
        fill_rungs(&view, self.frame, sources, told, benches);
        discs.resize_with(discs.len().max(rungs.count()), Disc::default);
        for strip in sources.iter().flat_map(Strips::iter) {
            let disc = &mut discs[rungs.steps(strip.rung)];
            if disc.is_vacant() {
                *disc = Disc::new(rungs.radius(strip.rung).abs());
            }
        }
        let shown = self.frame.shown_size();
        bands.resize_with(shown.height.div_ceil(ROWS), Band::default);
        let out = outputs.push([shown.height, shown.width, surfaces.channels]);
        let blurs = Blurs { rungs, discs, frame: self.frame };
        blurs.see(sources, gaps, view.reference(), bands, benches, out);
        let all = told.iter().chain(bands.iter().map(|band| &band.told));
        saved.piece =
            all.fold(0, |sum: u64, told| (sum ^ told.piece).wrapping_mul(0x0100_0000_01b3));
        saved.capped = count_capped(&surfaces.distances, &view.optics);
        Ok(())
    }

    fn keeps(&self, _: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1).input(2)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Saved<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Saved { surfaces, rungs, gaps, discs, sources, bands, benches, bars, .. } = saved;
        let view = self.view(surfaces, rungs, [0, 1, 2].map(|k| kept.input(k)));
        let blurs = Blurs { rungs, discs, frame: self.frame };
        bars.strips.resize_with(bands.len(), Strips::default);
        blurs.pull_back_seen(bands, gaps, kept.only_upstream(), &mut bars.strips, benches);
        bars.clear(surfaces);
        let mut optics = [T::Wide::ZERO; 2];
        bars.bands.resize_with(BANDS_AT_ONCE, BandBars::default);
        let mut background = gradients.take(0);
        for first in (0..sources.len()).step_by(BANDS_AT_ONCE) {
            let count = BANDS_AT_ONCE.min(sources.len() - first);
            let strips = &bars.strips;
            for_each_item_mut(&mut bars.bands[..count], |k, found| {
                benches.with(|bench| {
                    let band = first + k;
                    blurs.pull_back_rungs(&view, &sources[band], strips, band, found, bench);
                });
            });
            for k in 0..count {
                let sums = bars.add_band(k, surfaces);
                optics.iter_mut().zip(sums).for_each(|(sum, term)| *sum += term);
                if let Some(background) = &mut background {
                    let rows = (first + k) * ROWS * self.frame.size.width * surfaces.channels;
                    let start = if self.kind == Kind::Image { rows } else { 0 };
                    let entries = &mut background.entries()[start..];
                    for (to, &bar) in entries.iter_mut().zip(&bars.bands[k].background) {
                        *to += T::narrow(bar);
                    }
                }
            }
        }
        if let Some(background) = background {
            gradients.put_back(0, background);
        }
        for (k, sum) in optics.into_iter().enumerate() {
            if let Some(bar) = gradients.get(1 + k) {
                bar.add_each(|_| T::narrow(sum));
            }
        }
        self.give_layers(bars, surfaces.channels, gradients);
    }

    fn saved_bytes(&self, saved: &Saved<T>) -> usize {
        let blurred = saved.bands.iter().map(|band| band.blurred.bytes()).sum::<usize>();
        saved.surfaces.bytes() + bytes_of(&saved.sources) + blurred
    }
}

impl<T: Scalar> SavedBars<T> {
    /// Forgets all gradients of surfaces.
    fn clear(&mut self, surfaces: &Surfaces<T>) {
        let Self { colors, alphas, distances, weights, .. } = self;
        let pairs = [
            (colors, &surfaces.colors),
            (alphas, &surfaces.alphas),
            (distances, &surfaces.distances),
            (weights, &surfaces.weights),
        ];
        for (bars, like) in pairs {
            bars.clear();
            bars.resize(like.len(), T::ZERO);
        }
    }

    /// Adds what a band found; returns the gradients of aperture and focus.
    fn add_band(&mut self, band: usize, surfaces: &Surfaces<T>) -> [T::Wide; 2] {
        let (found, channels) = (&self.bands[band], surfaces.channels);
        for (&surface, bars) in found.surfaces.iter().zip(found.bars.chunks_exact(channels + 2)) {
            let at = surface as usize;
            let colors = &mut self.colors[at * channels..][..channels];
            colors.iter_mut().zip(bars).for_each(|(to, &bar)| *to += T::narrow(bar));
            self.alphas[at] += T::narrow(bars[channels]);
            self.distances[at] += T::narrow(bars[channels + 1]);
        }
        for &(piece, bar) in &found.weights {
            self.weights[piece as usize - surfaces.centers] += T::narrow(bar);
        }
        found.optics
    }
}
