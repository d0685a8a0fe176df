//! The operation that looks textures up.

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, Var, sum};
use smallvec::SmallVec;

use super::chart::{Chart, Cube, Plane};
use super::footprint::Footprint;
use super::levels::{CubeMap, Texture};
use super::lookup::{Cell, Level};
use super::options::{Detail, MOST_PROBES, Sampler, TextureFilter};
use super::texels::{TexelSums, Touch, Touches};
use crate::error::RenderError;

/// Samples of a texture at `coordinates: [N, 2]`, in the order (u, v): `[N, C]`.
///
/// (0, 0) is the upper left corner of the texture, whose row 0 is on top, and (1, 1) the lower right
/// corner. Gradients go to the texels of all levels, to the coordinates, and to the level or to the
/// differentials and the bias. A texture of one level needs no detail and looks at none.
///
/// It costs some 10 ns per sample with mipmaps and three channels, and three times as much with all
/// gradients; each probe of an anisotropic filter costs as much.
///
/// # Errors
/// - [`RenderError::Shape`] unless the coordinates are `[N, 2]`, a level `[N]` or a single number, and
///   differentials `[N, 2, 2]`.
/// - [`RenderError::NotFinite`] for a coordinate, a level, a bias or a differential that is infinite or
///   NaN.
/// - [`RenderError::BadSampler`] for a number of probes that is not from 1 to [`MOST_PROBES`], or probes
///   without differentials.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn sample_texture<'t, T: Scalar>(
    texture: &Texture<'t, T>,
    coordinates: Var<'t, T>,
    detail: Detail<'t, T>,
    sampler: Sampler,
) -> Result<Var<'t, T>, RenderError> {
    sample(Plane { border: sampler.border }, &texture.levels, coordinates, detail, sampler)
}

/// Samples of a cube map in `directions: [N, 3]`, of any length but 0: `[N, C]`. Samples go on over the
/// edges of the faces, so no edge is seen.
///
/// Gradients and cost are those of [`sample_texture`]. The sampler's border is not asked for.
///
/// # Errors
/// As [`sample_texture`], with directions `[N, 3]` and differentials `[N, 3, 2]`; and
/// [`RenderError::Direction`] for a direction of length 0.
#[inline(never)]
pub fn sample_cube_map<'t, T: Scalar>(
    map: &CubeMap<'t, T>,
    directions: Var<'t, T>,
    detail: Detail<'t, T>,
    sampler: Sampler,
) -> Result<Var<'t, T>, RenderError> {
    sample(Cube, &map.levels, directions, detail, sampler)
}

fn sample<'t, T: Scalar, C: Chart<K>, const K: usize>(
    chart: C,
    levels: &[Var<'t, T>],
    coordinates: Var<'t, T>,
    detail: Detail<'t, T>,
    sampler: Sampler,
) -> Result<Var<'t, T>, RenderError> {
    let probes = sampler.filter.probes();
    if !(1..=MOST_PROBES).contains(&probes) {
        let rule = "from 1 to 8 probes";
        return Err(RenderError::BadSampler { operation: C::OPERATION, rule, given: probes });
    }
    let top = sampler.coarsest.unwrap_or(usize::MAX).min(levels.len() - 1);
    let mut inputs: SmallVec<[Var<'t, T>; 20]> = SmallVec::new();
    inputs.push(coordinates);
    let mut kind = Kind::Finest;
    match detail {
        Detail::Finest => {}
        // A single level is the level, whatever its detail.
        Detail::Level(_) | Detail::Differentials { .. } if top == 0 && probes == 1 => {
            coordinates.tape().leave_out(C::OPERATION, "detail: there is a single level");
        }
        Detail::Level(level) => {
            inputs.push(level);
            kind = Kind::Level;
        }
        Detail::Differentials { differentials, bias } => {
            inputs.push(differentials);
            kind = Kind::Differentials;
            if let Some(bias) = bias {
                inputs.push(bias);
                kind = Kind::BiasedDifferentials;
            }
        }
    }
    if probes > 1 && !matches!(kind, Kind::Differentials | Kind::BiasedDifferentials) {
        let rule = "differentials for more than one probe";
        return Err(RenderError::BadSampler { operation: C::OPERATION, rule, given: probes });
    }
    inputs.extend_from_slice(&levels[..=top]);
    let op = Sample { chart, filter: sampler.filter, kind };
    coordinates.tape().apply(op, &inputs)
}

/// What stands between the coordinates and the levels in the inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Nothing.
    Finest,
    /// The level.
    Level,
    /// Differentials.
    Differentials,
    /// Differentials and a bias.
    BiasedDifferentials,
}

impl Kind {
    /// The input that is the first level.
    fn first_level(self) -> usize {
        match self {
            Self::Finest => 1,
            Self::Level | Self::Differentials => 2,
            Self::BiasedDifferentials => 3,
        }
    }
}

/// Inputs: coordinates `[N, K]`, what `kind` says, levels. Output: `[N, C]`.
struct Sample<C, const K: usize> {
    chart: C,
    filter: TextureFilter,
    kind: Kind,
}

/// Samples in one piece of work.
const SAMPLES_PER_PIECE: usize = 1 << 11;

type Levels<'a, T> = SmallVec<[Level<'a, T>; 16]>;

/// The samples of a texture, as they are looked up.
struct Lookups<'a, T, C, const K: usize> {
    chart: C,
    filter: TextureFilter,
    coordinates: &'a [[T; K]],
    level: Option<&'a [T]>,
    differentials: Option<&'a [[[T; 2]; K]]>,
    bias: Option<&'a [T]>,
    levels: Levels<'a, T>,
}

/// Which part of the texture a sample is made of.
#[derive(Debug, Clone, Copy)]
struct Spot<T, const K: usize> {
    coordinates: [T; K],
    /// The finer level.
    level: usize,
    /// The coarser level's share; nothing where the level is not free.
    fraction: T,
    /// Whether the level moves with what it follows from.
    is_free: bool,
    footprint: Option<Footprint<T>>,
    /// The longer axis of the footprint, as a change of the coordinates.
    axis: [T; K],
    probes: usize,
}

impl<T: Scalar, C: Chart<K>, const K: usize> Lookups<'_, T, C, K> {
    /// How a place changes from pixel to pixel, in texels of level 0.
    #[inline(always)]
    fn slopes(&self, coordinates: [T; K], slopes: [[T; 2]; K]) -> [[T; 2]; 2] {
        let [rows, columns] = self.levels[0].extents.map(|extent| T::from_f64(extent as f64));
        let [s, t] = self.chart.slopes(coordinates, slopes);
        [s.map(|slope| columns * slope), t.map(|slope| rows * slope)]
    }

    #[inline(always)]
    fn spot(&self, n: usize) -> Spot<T, K> {
        let coordinates = self.coordinates[n];
        let mut spot = Spot {
            coordinates,
            level: 0,
            fraction: T::ZERO,
            is_free: false,
            footprint: None,
            axis: [T::ZERO; K],
            probes: 1,
        };
        let of = |numbers: &[T]| if numbers.len() == 1 { numbers[0] } else { numbers[n] };
        let level = match (self.level, self.differentials) {
            (Some(level), _) => of(level),
            (None, Some(differentials)) => {
                let slopes = differentials[n];
                let footprint =
                    Footprint::of(self.slopes(coordinates, slopes), self.filter.probes());
                if footprint.probes > 1 {
                    let [x, y] = footprint.direction();
                    spot.axis = slopes.map(|slope| slope[0] * x + slope[1] * y);
                    spot.probes = footprint.probes;
                }
                spot.footprint = Some(footprint);
                footprint.level() + self.bias.map_or(T::ZERO, of)
            }
            _ => return spot,
        };
        let top = T::from_f64((self.levels.len() - 1) as f64);
        if !self.filter.mixes_levels() {
            let nearest = (level.to_f64() + 0.5).max(0.0);
            spot.level = (nearest as usize).min(self.levels.len() - 1);
        } else if level > T::ZERO && level < top {
            spot.level = level.to_f64() as usize;
            spot.fraction = level - T::from_f64(spot.level as f64);
            spot.is_free = true;
        } else if !(level <= T::ZERO) {
            spot.level = self.levels.len() - 1;
        }
        spot
    }

    /// The coordinates of a spot's probe.
    #[inline(always)]
    fn probe(&self, spot: &Spot<T, K>, k: usize) -> [T; K] {
        match &spot.footprint {
            Some(footprint) if spot.probes > 1 => {
                let offset = footprint.offset(k);
                std::array::from_fn(|i| spot.coordinates[i] + offset * spot.axis[i])
            }
            _ => spot.coordinates,
        }
    }

    /// The cell of coordinates on a level.
    #[inline(always)]
    fn cell(&self, coordinates: [T; K], level: usize) -> Option<Cell<T>> {
        let place = self.chart.place(coordinates);
        let is_nearest = self.filter == TextureFilter::Nearest;
        Cell::of(self.chart, place, self.levels[level].extents, is_nearest)
    }

    /// Calls `visit(level, share)` for the levels of a spot.
    #[inline(always)]
    fn for_each_level(&self, spot: &Spot<T, K>, mut visit: impl FnMut(usize, T)) {
        if spot.is_free {
            visit(spot.level, T::ONE - spot.fraction);
            visit(spot.level + 1, spot.fraction);
        } else {
            visit(spot.level, T::ONE);
        }
    }

    /// The share of a probe in its sample.
    #[inline(always)]
    fn share(spot: &Spot<T, K>) -> T {
        T::from_f64(1.0 / spot.probes as f64)
    }

    /// Writes sample n.
    #[inline(always)]
    fn write(&self, n: usize, out: &mut [T]) {
        let spot = self.spot(n);
        if spot.probes == 1 {
            return self.write_probe(&spot, spot.coordinates, out);
        }
        out.fill(T::ZERO);
        let mut probe: SmallVec<[T; 8]> = SmallVec::from_elem(T::ZERO, out.len());
        for k in 0..spot.probes {
            self.write_probe(&spot, self.probe(&spot, k), &mut probe);
            out.iter_mut().zip(&probe).for_each(|(out, &probe)| *out += probe);
        }
        let share = Self::share(&spot);
        out.iter_mut().for_each(|out| *out = share * *out);
    }

    #[inline(always)]
    fn write_probe(&self, spot: &Spot<T, K>, coordinates: [T; K], out: &mut [T]) {
        match out.len() {
            3 => self.write_channels::<3>(spot, coordinates, 0, out),
            4 => self.write_channels::<4>(spot, coordinates, 0, out),
            _ => {
                for (first, out) in out.chunks_exact_mut(1).enumerate() {
                    self.write_channels::<1>(spot, coordinates, first, out);
                }
            }
        }
    }

    /// Writes `N` channels, from `first` on.
    #[inline(always)]
    fn write_channels<const N: usize>(
        &self,
        spot: &Spot<T, K>,
        coordinates: [T; K],
        first: usize,
        out: &mut [T],
    ) {
        let of = |level: usize| match self.cell(coordinates, level) {
            Some(cell) => self.levels[level].sample::<K, N>(self.chart, &cell, first),
            None => [T::ZERO; N],
        };
        let finer = of(spot.level);
        if !spot.is_free {
            return out.copy_from_slice(&finer);
        }
        let coarser = of(spot.level + 1);
        for c in 0..N {
            out[c] = finer[c] + spot.fraction * (coarser[c] - finer[c]);
        }
    }

    /// The gradients of a probe's place and of its level.
    #[inline(always)]
    fn pull_back_probe(&self, spot: &Spot<T, K>, coordinates: [T; K], bars: &[T]) -> ([T; 2], T) {
        match bars {
            &[a, b, c] => self.pull_back_channels(spot, coordinates, 0, &[a, b, c]),
            &[a, b, c, d] => self.pull_back_channels(spot, coordinates, 0, &[a, b, c, d]),
            _ => {
                let (mut at_bar, mut level_bar) = ([T::ZERO; 2], T::ZERO);
                for (first, &bar) in bars.iter().enumerate() {
                    let (own, own_level) =
                        self.pull_back_channels(spot, coordinates, first, &[bar]);
                    at_bar[0] += own[0];
                    at_bar[1] += own[1];
                    level_bar += own_level;
                }
                (at_bar, level_bar)
            }
        }
    }

    /// The same from `N` channels, from `first` on.
    #[inline(always)]
    fn pull_back_channels<const N: usize>(
        &self,
        spot: &Spot<T, K>,
        coordinates: [T; K],
        first: usize,
        bars: &[T; N],
    ) -> ([T; 2], T) {
        let of = |level: usize| match self.cell(coordinates, level) {
            Some(cell) => self.levels[level].sample_along::<K, N>(self.chart, &cell, first, bars),
            None => ([T::ZERO; N], [T::ZERO; 2]),
        };
        let (finer, mut at_bar) = of(spot.level);
        let mut level_bar = T::ZERO;
        if spot.is_free {
            let (coarser, other) = of(spot.level + 1);
            for i in 0..2 {
                at_bar[i] += spot.fraction * (other[i] - at_bar[i]);
            }
            for c in 0..N {
                level_bar += bars[c] * (coarser[c] - finer[c]);
            }
        }
        (at_bar, level_bar)
    }

    /// The gradients of sample n's coordinates, differentials and level.
    #[inline(always)]
    fn pull_back(&self, n: usize, bars: &[T]) -> ([T; K], [[T; 2]; K], T) {
        let spot = self.spot(n);
        let share = Self::share(&spot);
        let (mut bar, mut axis_bar, mut level_bar) = ([T::ZERO; K], [T::ZERO; K], T::ZERO);
        for k in 0..spot.probes {
            let coordinates = self.probe(&spot, k);
            let (at_bar, own_level) = self.pull_back_probe(&spot, coordinates, bars);
            level_bar += share * own_level;
            let own = self.chart.pull_back(coordinates, at_bar.map(|bar| share * bar));
            for i in 0..K {
                bar[i] += own[i];
            }
            if let Some(footprint) = spot.footprint.filter(|_| spot.probes > 1) {
                let offset = footprint.offset(k);
                for i in 0..K {
                    axis_bar[i] += offset * own[i];
                }
            }
        }
        let mut slopes_bar = [[T::ZERO; 2]; K];
        if let (Some(footprint), Some(differentials)) = (&spot.footprint, self.differentials)
            && (spot.is_free || spot.probes > 1)
        {
            let slopes = differentials[n];
            let direction = footprint.direction();
            // axis = D v.
            let mut v_bar = [T::ZERO; 2];
            for i in 0..K {
                for k in 0..2 {
                    v_bar[k] += slopes[i][k] * axis_bar[i];
                    slopes_bar[i][k] += axis_bar[i] * direction[k];
                }
            }
            let j = self.slopes(spot.coordinates, slopes);
            let [s_bar, t_bar] = footprint.pull_back(j, level_bar, v_bar);
            let [rows, columns] = self.levels[0].extents.map(|extent| T::from_f64(extent as f64));
            let j_bar = [s_bar.map(|bar| columns * bar), t_bar.map(|bar| rows * bar)];
            let (own, own_slopes) = self.chart.pull_back_slopes(spot.coordinates, slopes, j_bar);
            for i in 0..K {
                bar[i] += own[i];
                for k in 0..2 {
                    slopes_bar[i][k] += own_slopes[i][k];
                }
            }
        }
        (bar, slopes_bar, level_bar)
    }
}

impl<T: Scalar, C: Chart<K>, const K: usize> Touches<T> for Lookups<'_, T, C, K> {
    #[inline(always)]
    fn for_each(&self, n: usize, mut touch: impl FnMut(usize, usize, Cell<T>)) {
        let spot = self.spot(n);
        for probe in 0..spot.probes {
            let coordinates = self.probe(&spot, probe);
            self.for_each_level(&spot, |level, _| {
                if let Some(cell) = self.cell(coordinates, level) {
                    touch(probe, level, cell);
                }
            });
        }
    }

    #[inline(always)]
    fn touch(&self, n: usize, probe: usize, level: usize) -> Touch<T> {
        let spot = self.spot(n);
        let cell = self.cell(self.probe(&spot, probe), level).expect("it was found there before");
        let mut weight = Self::share(&spot);
        if spot.is_free {
            let fraction = if level == spot.level { T::ONE - spot.fraction } else { spot.fraction };
            weight = weight * fraction;
        }
        Touch { cell, weight }
    }
}

/// # Errors
/// [`RenderError::NotFinite`] unless all of `numbers` are finite.
fn check_finite<T: Scalar>(
    operation: &'static str,
    what: &'static str,
    numbers: &[T],
    width: usize,
) -> Result<(), RenderError> {
    let is_finite = |chunk: &[T]| chunk.iter().fold(true, |all, number| all & number.is_finite());
    if numbers.chunks(1024).all(is_finite) {
        return Ok(());
    }
    let at = numbers.iter().position(|number| !number.is_finite()).expect("it was found above");
    let value = numbers[at].to_f64();
    Err(RenderError::NotFinite { operation, what, row: at / width.max(1), value })
}

impl<C: Chart<K>, const K: usize> Sample<C, K> {
    /// # Errors
    /// [`RenderError::Shape`] for inputs of a wrong shape.
    fn check_shapes<T: Scalar>(&self, inputs: &Inputs<'_, T>) -> Result<usize, RenderError> {
        let wrong = |rule: String, shape: &Shape| RenderError::Shape {
            operation: C::OPERATION,
            rule,
            shape: shape.clone(),
        };
        let what = if K == 2 { "coordinates" } else { "directions" };
        let count = match **inputs.shape(0) {
            [count, k] if k == K => count,
            _ => return Err(wrong(format!("{what} of shape [N, {K}]"), inputs.shape(0))),
        };
        let numbers = |i: usize, what: &str| {
            let shape = inputs.shape(i);
            if shape.size() != 1 && **shape != [count] {
                let rule = format!("{what} of shape [{count}], or a single number");
                return Err(wrong(rule, shape));
            }
            Ok(())
        };
        match self.kind {
            Kind::Finest => {}
            Kind::Level => numbers(1, "levels")?,
            Kind::Differentials | Kind::BiasedDifferentials => {
                if **inputs.shape(1) != [count, K, 2] {
                    let rule = format!("differentials of shape [{count}, {K}, 2]");
                    return Err(wrong(rule, inputs.shape(1)));
                }
                if self.kind == Kind::BiasedDifferentials {
                    numbers(2, "a bias")?;
                }
            }
        }
        Ok(count)
    }

    /// # Errors
    /// [`RenderError::NotFinite`] and [`RenderError::Direction`].
    fn check_numbers<T: Scalar>(&self, inputs: &Inputs<'_, T>) -> Result<(), RenderError> {
        let (operation, coordinates) = (C::OPERATION, inputs.data(0));
        check_finite(operation, if K == 2 { "coordinates" } else { "directions" }, coordinates, K)?;
        match self.kind {
            Kind::Finest => {}
            Kind::Level => check_finite(operation, "levels", inputs.data(1), 1)?,
            Kind::Differentials | Kind::BiasedDifferentials => {
                check_finite(operation, "differentials", inputs.data(1), 2 * K)?;
                if self.kind == Kind::BiasedDifferentials {
                    check_finite(operation, "biases", inputs.data(2), 1)?;
                }
            }
        }
        if K == 3 {
            let zero = |direction: &[T; K]| direction.iter().all(|&d| d == T::ZERO);
            if let Some(row) = coordinates.as_chunks::<K>().0.iter().position(zero) {
                return Err(RenderError::Direction { operation, row });
            }
        }
        Ok(())
    }

    fn lookups<'a, T: Scalar>(
        &self,
        input: impl Fn(usize) -> &'a [T],
        shape: impl Fn(usize) -> &'a Shape,
        inputs: usize,
        needs_texels: bool,
    ) -> Lookups<'a, T, C, K> {
        let first = self.kind.first_level();
        let levels = (first..inputs).map(|i| {
            let &[.., rows, columns, channels] = &**shape(i) else {
                unreachable!("it was checked")
            };
            let texels = if needs_texels { input(i) } else { &[] };
            Level { texels, extents: [rows, columns], channels }
        });
        let mut lookups = Lookups {
            chart: self.chart,
            filter: self.filter,
            coordinates: input(0).as_chunks().0,
            level: None,
            differentials: None,
            bias: None,
            levels: levels.collect(),
        };
        match self.kind {
            Kind::Finest => {}
            Kind::Level => lookups.level = Some(input(1)),
            Kind::Differentials | Kind::BiasedDifferentials => {
                lookups.differentials = Some(input(1).as_chunks::<2>().0.as_chunks().0);
                if self.kind == Kind::BiasedDifferentials {
                    lookups.bias = Some(input(2));
                }
            }
        }
        lookups
    }

    /// Whether something beside the texels gets a gradient, as `needs` says of inputs: not what
    /// samples are step functions of.
    fn moves(&self, needs: impl Fn(usize) -> bool) -> bool {
        match self.filter {
            TextureFilter::Nearest => false,
            TextureFilter::Bilinear => needs(0),
            _ => (0..self.kind.first_level()).any(needs),
        }
    }
}

impl<T: Scalar, C: Chart<K>, const K: usize> Op<T> for Sample<C, K> {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        C::OPERATION
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Saved<T>,
    ) -> Result<(), RenderError> {
        let count = self.check_shapes(inputs)?;
        self.check_numbers(inputs)?;
        let lookups = self.lookups(|i| inputs.data(i), |i| inputs.shape(i), inputs.len(), true);
        let channels = lookups.levels[0].channels;
        let out = outputs.push([count, channels]);
        for_each_piece_mut(out, SAMPLES_PER_PIECE * channels, |piece, out| {
            let samples = piece * SAMPLES_PER_PIECE..;
            for (n, out) in samples.zip(out.chunks_exact_mut(channels)) {
                lookups.write(n, out);
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let first = self.kind.first_level();
        let mut keep = (0..first).fold(Keep::NOTHING, Keep::input);
        if self.moves(|i| inputs.needs(i)) {
            keep = (first..inputs.len()).fold(keep, Keep::input);
        }
        keep
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Saved<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let (first, count) = (self.kind.first_level(), kept.input_shape(0)[0]);
        let bars = kept.only_upstream();
        let moves = self.moves(|i| gradients.needs(i));
        let input = |i: usize| kept.input(i);
        let lookups = self.lookups(input, |i| kept.input_shape(i), kept.input_count(), moves);
        let channels = lookups.levels[0].channels;
        if moves {
            self.pull_back(&lookups, count, bars, channels, saved, gradients);
        }
        let wanted: SmallVec<[bool; 16]> =
            (first..kept.input_count()).map(|i| gradients.needs(i)).collect();
        if !wanted.contains(&true) {
            return;
        }
        let extents = lookups.levels.iter().map(|level| level.extents);
        saved.texels.sort(&lookups, count, extents, [C::FACES, channels], |level| wanted[level]);
        for level in 0..wanted.len() {
            let Some(level_bar) = gradients.get(first + level) else { continue };
            saved.texels.add_level(
                self.chart,
                &lookups,
                level,
                bars,
                channels,
                level_bar.entries(),
            );
        }
    }

    fn saved_bytes(&self, saved: &Saved<T>) -> usize {
        saved.texels.bytes() + size_of_val(saved.moves.as_slice())
    }
}

/// Memory of the backward pass.
#[derive(Debug)]
struct Saved<T: Scalar> {
    texels: TexelSums<T>,
    /// Gradients of coordinates, differentials and levels, sample by sample.
    moves: Vec<T>,
}

impl<T: Scalar> Default for Saved<T> {
    fn default() -> Self {
        Self { texels: TexelSums::default(), moves: Vec::new() }
    }
}

impl<C: Chart<K>, const K: usize> Sample<C, K> {
    /// Adds the gradients of coordinates, differentials, level and bias.
    fn pull_back<T: Scalar>(
        &self,
        lookups: &Lookups<'_, T, C, K>,
        count: usize,
        bars: &[T],
        channels: usize,
        saved: &mut Saved<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let bias = if self.kind == Kind::Level { 1 } else { 2 };
        let mixes = self.filter.mixes_levels();
        let has_level = matches!(self.kind, Kind::Level | Kind::BiasedDifferentials);
        let wants = [
            gradients.needs(0),
            mixes && bias == 2 && self.kind != Kind::Finest && gradients.needs(1),
            mixes && has_level && gradients.needs(bias),
        ];
        if wants == [true, false, false] {
            let coordinates_bar = gradients.get(0).expect("it is wanted");
            let (entries, is_fresh) = coordinates_bar.entries_or_fresh();
            return for_each_piece_mut(entries, K * SAMPLES_PER_PIECE, |piece, entries| {
                let rows = (piece * SAMPLES_PER_PIECE..).zip(entries.as_chunks_mut::<K>().0);
                for (n, entries) in rows {
                    let (bar, ..) = lookups.pull_back(n, &bars[n * channels..][..channels]);
                    for (entry, bar) in entries.iter_mut().zip(bar) {
                        *entry = if is_fresh { bar } else { *entry + bar };
                    }
                }
            });
        }
        let widths = [K, 2 * K, 1];
        let starts = [0, K, 3 * K];
        let width = 3 * K + 1;
        let moves = &mut saved.moves;
        moves.clear();
        moves.resize(count * width, T::ZERO);
        for_each_piece_mut(moves, width * SAMPLES_PER_PIECE, |piece, moves| {
            let rows = (piece * SAMPLES_PER_PIECE..).zip(moves.chunks_exact_mut(width));
            for (n, moves) in rows {
                let (bar, slopes, level) = lookups.pull_back(n, &bars[n * channels..][..channels]);
                moves[..K].copy_from_slice(&bar);
                moves[K..3 * K].copy_from_slice(slopes.as_flattened());
                moves[3 * K] = level;
            }
        });
        for part in (0..3).filter(|&part| wants[part]) {
            let i = [0, 1, bias][part];
            let Some(own_bar) = gradients.get(i) else { continue };
            let (entries, is_fresh) = own_bar.entries_or_fresh();
            let (start, own) = (starts[part], widths[part]);
            if entries.len() != count * own {
                // One number for all samples.
                let total = T::narrow(sum::<T>(count, |n| moves[n * width + start].widen()));
                entries[0] = if is_fresh { total } else { entries[0] + total };
                continue;
            }
            for_each_piece_mut(entries, own * SAMPLES_PER_PIECE, |piece, entries| {
                let moves = moves[piece * SAMPLES_PER_PIECE * width..].chunks_exact(width);
                for (entries, moves) in entries.chunks_exact_mut(own).zip(moves) {
                    for (entry, &bar) in entries.iter_mut().zip(&moves[start..]) {
                        *entry = if is_fresh { bar } else { *entry + bar };
                    }
                }
            });
        }
    }
}
