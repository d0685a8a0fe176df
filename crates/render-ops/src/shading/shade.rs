//! The operation that lights surfaces.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{
    Accumulator, Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, TensorError, Var,
};
use smallvec::SmallVec;

use super::blocks::{
    BLOCK, Column, Lanes, MOST_PARTS, PIECE, Written, add_row, for_each_piece, row, set_row, store,
};
use super::direction::{pull_back_unit, unit};
use super::light::{Kind, Light, Surface};
use super::material::Material;
use super::matt::{BlinnPhong, Lambert, Phong};
use super::metallic_roughness::MetallicRoughness;
use super::model::Model;
use crate::error::RenderError;
use crate::vector::{dot, plus};

const NAME: &str = "shade";

/// The radiance that reaches the eye from `surface`, made of `material`, in the light of `lights`:
/// `[N, 3]`. Without lights it is black.
///
/// Gradients go to all variables of surface, material and lights. Normals and views are normalized, so
/// interpolated ones will do. A light behind the surface adds nothing. An eye behind the surface sees it
/// as from the side.
///
/// # Errors
/// - [`RenderError::Shape`] unless normals are `[N, 3]`, and all others as their type says.
/// - [`RenderError::Direction`] for a normal, a view or a light's direction of length 0.
/// - [`RenderError::NotFinite`] for a number that is infinite or NaN, and for a point light so close to a
///   position that the inverse square of the distance is.
/// - `TensorError::Value` for a light whose strength is negative.
/// - `TensorError::Inputs` for a point light without positions.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn shade<'t, T: Scalar>(
    surface: &Surface<'t, T>,
    material: &Material<'t, T>,
    lights: &[Light<'t, T>],
) -> Result<Var<'t, T>, RenderError> {
    match *material {
        Material::MetallicRoughness { base_color, roughness, metallic, conserves_energy } => {
            let parts = [base_color, roughness, metallic];
            if conserves_energy {
                record(MetallicRoughness::<true>, surface, &parts, lights)
            } else {
                record(MetallicRoughness::<false>, surface, &parts, lights)
            }
        }
        Material::Lambert { color } => record(Lambert, surface, &[color], lights),
        Material::Phong { color, specular, exponent } => {
            record(Phong, surface, &[color, specular, exponent], lights)
        }
        Material::BlinnPhong { color, specular, exponent } => {
            record(BlinnPhong, surface, &[color, specular, exponent], lights)
        }
    }
}

fn record<'t, T: Scalar, const M: usize>(
    model: impl Model<M>,
    surface: &Surface<'t, T>,
    material: &[Var<'t, T>],
    lights: &[Light<'t, T>],
) -> Result<Var<'t, T>, RenderError> {
    let mut inputs: SmallVec<[Var<'t, T>; 16]> = SmallVec::new();
    inputs.extend([surface.normals, surface.views]);
    let kinds: SmallVec<[Kind; 8]> = lights.iter().map(|light| light.parts().0).collect();
    let has_points = kinds.contains(&Kind::Point);
    if has_points {
        let Some(positions) = surface.positions else {
            let rule = "positions of the surface in the light of a point".into();
            return Err(TensorError::Inputs { operation: NAME, rule, given: 2 }.into());
        };
        inputs.push(positions);
    }
    inputs.extend_from_slice(material);
    for light in lights {
        inputs.extend(light.parts().1.into_iter().flatten());
    }
    surface.normals.tape().apply(Shade::<_, M> { model, kinds, has_points }, &inputs)
}

/// Inputs: normals, views, positions where a light is a point, the parts of the material, and of each
/// light its place, unless it is everywhere, and its strength. Output: `[N, 3]`.
struct Shade<M, const K: usize> {
    model: M,
    kinds: SmallVec<[Kind; 8]>,
    has_points: bool,
}

/// A light, in numbers.
#[derive(Debug, Clone, Copy)]
struct Lamp<T> {
    kind: Kind,
    /// Its position, or the unit vector to it.
    place: [T; 3],
    /// The length of its direction.
    length: T,
    strength: [T; 3],
}

/// Sums over rows: of normals, views, positions, and then of each light.
const SUMS_OF_GEOMETRY: usize = 9;
const SUMS_OF_LIGHT: usize = 6;

/// What a block's rows are, as numbers on the stack.
struct Block<T, const M: usize> {
    rows: Range<usize>,
    normals: Lanes<T, 3>,
    normal_lengths: Lanes<T, 1>,
    views: Lanes<T, 3>,
    view_lengths: Lanes<T, 1>,
    positions: Lanes<T, 3>,
    material: Lanes<T, M>,
}

impl<T: Scalar, const M: usize> Block<T, M> {
    /// Normal, view and material of a row.
    #[inline(always)]
    fn surface(&self, k: usize) -> ([T; 3], [T; 3], [T; M]) {
        (row(&self.normals, k), row(&self.views, k), row(&self.material, k))
    }
}

/// All inputs of rows.
struct Columns<'a, T> {
    normals: Column<'a, T>,
    views: Column<'a, T>,
    positions: Option<Column<'a, T>>,
    material: SmallVec<[Column<'a, T>; 4]>,
}

impl<T: Scalar> Columns<'_, T> {
    /// The numbers of `rows`, with unit vectors; and whether all are finite and directions have a
    /// length.
    #[inline(always)]
    fn load<const M: usize>(&self, rows: Range<usize>) -> (Block<T, M>, bool) {
        let mut block = Block {
            normals: [[T::ZERO; BLOCK]; 3],
            normal_lengths: [[T::ZERO; BLOCK]; 1],
            views: [[T::ZERO; BLOCK]; 3],
            view_lengths: [[T::ZERO; BLOCK]; 1],
            positions: [[T::ZERO; BLOCK]; 3],
            material: [[T::ZERO; BLOCK]; M],
            rows,
        };
        let rows = &block.rows;
        self.normals.load(rows, &mut block.normals);
        self.views.load(rows, &mut block.views);
        if let Some(positions) = &self.positions {
            positions.load(rows, &mut block.positions);
        }
        let mut first = 0;
        for column in &self.material {
            column.load(rows, &mut block.material[first..first + column.width]);
            first += column.width;
        }
        let mut is_good = true;
        let directions = [
            (&mut block.normals, &mut block.normal_lengths),
            (&mut block.views, &mut block.view_lengths),
        ];
        for (lanes, lengths) in directions {
            for k in 0..BLOCK {
                let (direction, length) = unit(row(lanes, k));
                set_row(lanes, k, direction);
                lengths[0][k] = length;
                // The length may be beyond the range of the numbers: the unit vector is not.
                is_good &= dot(direction, direction).is_finite();
            }
        }
        for lane in block.material.iter().chain(&block.positions) {
            is_good = lane.iter().fold(is_good, |all, entry| all & entry.is_finite());
        }
        (block, is_good)
    }
}

impl<T: Scalar> Lamp<T> {
    /// The unit vector to a point light from `position`, the distance and its inverse square.
    #[inline(always)]
    fn seen_from(&self, position: [T; 3]) -> ([T; 3], T, T) {
        let (l, distance) = unit(plus(self.place, -T::ONE, position));
        (l, distance, T::ONE / distance / distance)
    }
}

/// The entries of `shape` in a row, where it is `[N, 3]` or `[3]` for a width of 3, `[N]` or `[]` for 1;
/// whether it is for all rows; `None` for any other shape.
fn is_uniform(shape: &Shape, width: usize, count: usize) -> Option<bool> {
    match (width, &**shape) {
        (1, []) => Some(true),
        (1, &[n]) if n == count => Some(false),
        (_, &[w]) if w == width && width > 1 => Some(true),
        (_, &[n, w]) if n == count && w == width && width > 1 => Some(false),
        _ => None,
    }
}

impl<M: Model<K>, const K: usize> Shade<M, K> {
    /// The first input of the material.
    fn first_part(&self) -> usize {
        2 + usize::from(self.has_points)
    }

    fn columns<'a, T: Scalar>(
        &self,
        count: usize,
        shape: impl Fn(usize) -> &'a Shape,
        data: impl Fn(usize) -> &'a [T],
    ) -> Columns<'a, T> {
        let column = |i: usize, width: usize| Column {
            entries: data(i),
            width,
            is_uniform: is_uniform(shape(i), width, count) == Some(true),
        };
        let first = self.first_part();
        let parts = M::PARTS.iter().enumerate();
        Columns {
            normals: column(0, 3),
            views: column(1, 3),
            positions: self.has_points.then(|| column(2, 3)),
            material: parts.map(|(k, &(_, width))| column(first + k, width)).collect(),
        }
    }

    /// Calls `visit(kind, place's input if it has one, strength's input)` for each light.
    fn light_inputs(&self) -> impl Iterator<Item = (Kind, Option<usize>, usize)> {
        let mut at = self.first_part() + M::PARTS.len();
        self.kinds.iter().map(move |&kind| {
            let place = (kind != Kind::Ambient).then(|| {
                at += 1;
                at - 1
            });
            at += 1;
            (kind, place, at - 1)
        })
    }

    fn lamps<'a, T: Scalar>(&self, data: impl Fn(usize) -> &'a [T]) -> SmallVec<[Lamp<T>; 8]> {
        let vector = |i: usize| *data(i).first_chunk::<3>().expect("it was checked");
        let lamp = |(kind, place, strength): (Kind, Option<usize>, usize)| {
            let place = place.map_or([T::ZERO; 3], &vector);
            let (place, length) =
                if kind == Kind::Directional { unit(place) } else { (place, T::ONE) };
            Lamp { kind, place, length, strength: vector(strength) }
        };
        self.light_inputs().map(lamp).collect()
    }

    /// # Errors
    /// As [`shade`], of all but the numbers of rows.
    fn check<T: Scalar>(&self, inputs: &Inputs<'_, T>) -> Result<usize, RenderError> {
        let refused = |rule: String, shape: &Shape| {
            Err(RenderError::Shape { operation: NAME, rule, shape: shape.clone() })
        };
        let &[count, 3] = &**inputs.shape(0) else {
            return refused("normals of shape [N, 3]".into(), inputs.shape(0));
        };
        let first = self.first_part();
        let geometry = [("views", 3), ("positions", 3)];
        let parts = geometry[..first - 1].iter().chain(M::PARTS);
        for (i, &(what, width)) in (1..).zip(parts) {
            let is_position = self.has_points && i == 2;
            match is_uniform(inputs.shape(i), width, count) {
                Some(is_uniform) if !(is_uniform && is_position) => {}
                _ => {
                    let rule = match (is_position, width) {
                        (true, _) => format!("{what} of shape [{count}, 3]"),
                        (_, 1) => format!("{what} of shape [{count}] or []"),
                        _ => format!("{what} of shape [{count}, {width}] or [{width}]"),
                    };
                    return refused(rule, inputs.shape(i));
                }
            }
        }
        for (kind, place, strength) in self.light_inputs() {
            for i in place.into_iter().chain([strength]) {
                let what = if i == strength { kind.strength() } else { kind.place() };
                if **inputs.shape(i) != [3] {
                    return refused(format!("{what} of shape [3]"), inputs.shape(i));
                }
                let entries = inputs.data(i);
                if let Some(entry) = entries.iter().find(|entry| !entry.is_finite()) {
                    let rule = format!("{what} that is finite").into();
                    let value = entry.to_f64();
                    return Err(TensorError::Value { operation: NAME, rule, value }.into());
                }
                let is_zero = entries.iter().all(|&entry| entry == T::ZERO);
                if i != strength && kind == Kind::Directional && is_zero {
                    let rule = format!("{what} other than zero").into();
                    return Err(TensorError::Value { operation: NAME, rule, value: 0.0 }.into());
                }
                if let Some(entry) = entries.iter().find(|&&entry| i == strength && entry < T::ZERO)
                {
                    let rule = format!("{what} of 0 or more").into();
                    let value = entry.to_f64();
                    return Err(TensorError::Value { operation: NAME, rule, value }.into());
                }
            }
        }
        Ok(count)
    }

    /// The error of the first row that has one.
    #[cold]
    fn refuse<T: Scalar>(
        &self,
        columns: &Columns<'_, T>,
        lamps: &[Lamp<T>],
        count: usize,
    ) -> RenderError {
        let row_of = |at: usize, column: &Column<'_, T>| {
            if column.is_uniform { 0 } else { at / column.width }
        };
        let names = [("normals", Some(&columns.normals)), ("views", Some(&columns.views))];
        let positions = [("positions", columns.positions.as_ref())];
        let material = M::PARTS.iter().zip(&columns.material);
        let material = material.map(|(&(what, _), column)| (what, Some(column)));
        let all = names.into_iter().chain(positions).chain(material);
        for (what, column) in all {
            let Some(column) = column else { continue };
            if let Some(at) = column.entries.iter().position(|entry| !entry.is_finite()) {
                let (row, value) = (row_of(at, column), column.entries[at].to_f64());
                return RenderError::NotFinite { operation: NAME, what, row, value };
            }
            let is_direction = what == "normals" || what == "views";
            let mut rows = column.entries.chunks(column.width);
            if is_direction
                && let Some(row) = rows.position(|row| row.iter().all(|&entry| entry == T::ZERO))
            {
                return RenderError::Direction { operation: NAME, row };
            }
        }
        let far = columns.positions.as_ref().and_then(|positions| {
            (0..count).find_map(|row| {
                let position = *positions.entries[3 * row..].first_chunk().expect("a row");
                let points = lamps.iter().filter(|lamp| lamp.kind == Kind::Point);
                let mut inverse = points.map(|lamp| lamp.seen_from(position).2.to_f64());
                inverse.find(|inverse| !inverse.is_finite()).map(|value| (row, value))
            })
        });
        let (row, value) = far.unwrap_or_default();
        let what = "inverse squares of distances to a point light";
        // A distance of 0 has no direction, and NaN for an inverse square.
        let value = if value.is_nan() { f64::INFINITY } else { value };
        RenderError::NotFinite { operation: NAME, what, row, value }
    }
}

/// Memory of a backward pass: sums of each piece.
#[derive(Debug)]
struct Saved<T: Scalar>(Vec<T::Wide>);

impl<T: Scalar> Default for Saved<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Scalar, M: Model<K>, const K: usize> Op<T> for Shade<M, K> {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Saved<T>,
    ) -> Result<(), RenderError> {
        let count = self.check(inputs)?;
        let columns = self.columns(count, |i| inputs.shape(i), |i| inputs.data(i));
        let lamps = self.lamps(|i| inputs.data(i));
        let out = outputs.push([count, 3]);
        let is_refused = AtomicBool::new(false);
        for_each_piece_mut(out, 3 * PIECE, |piece, out| {
            let is_good = pulp::Arch::new().dispatch(
                #[inline(always)]
                || {
                    let (columns, lamps) = (&columns, &lamps[..]);
                    let mut all_good = true;
                    for (k, out) in out.chunks_mut(3 * BLOCK).enumerate() {
                        let start = piece * PIECE + k * BLOCK;
                        let (block, is_good) = columns.load(start..start + out.len() / 3);
                        all_good &= is_good;
                        let (radiance, is_good) = lit(self.model, &block, lamps);
                        all_good &= is_good;
                        store(&radiance, out, true);
                    }
                    all_good
                },
            );
            if !is_good {
                is_refused.store(true, Ordering::Relaxed);
            }
        });
        if is_refused.into_inner() {
            return Err(self.refuse(&columns, &lamps, count));
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
        let count = kept.input_shape(0)[0];
        let columns = self.columns(count, |i| kept.input_shape(i), |i| kept.input(i));
        let lamps = self.lamps(|i| kept.input(i));
        let upstream = Column { entries: kept.only_upstream(), width: 3, is_uniform: false };
        // The columns in their order, and the input of each.
        let first = self.first_part();
        let geometry = [(0, Some(&columns.normals)), (1, Some(&columns.views))];
        let geometry = geometry.into_iter().chain([(2, columns.positions.as_ref())]);
        let all: SmallVec<[_; MOST_PARTS]> =
            geometry.chain((first..).zip(columns.material.iter().map(Some))).collect();
        let mut taken: [Option<Accumulator<T>>; MOST_PARTS] = Default::default();
        let mut has_sums = self
            .light_inputs()
            .any(|(_, place, i)| gradients.needs(i) || place.is_some_and(|i| gradients.needs(i)));
        for (taken, &(i, column)) in taken.iter_mut().zip(&all) {
            match column {
                Some(column) if column.is_uniform => has_sums |= gradients.needs(i),
                Some(_) => *taken = gradients.take(i),
                None => {}
            }
        }
        let mut fresh = [false; MOST_PARTS];
        let mut at = 0;
        let parts = taken.each_mut().map(|taken| {
            let width = all.get(at).and_then(|(_, column)| *column).map_or(0, |own| own.width);
            at += 1;
            let Some(taken) = taken else { return (0, &mut [][..]) };
            let (entries, is_fresh) = taken.entries_or_fresh();
            fresh[at - 1] = is_fresh;
            (width, entries)
        });
        let width = SUMS_OF_GEOMETRY + K + SUMS_OF_LIGHT * lamps.len();
        let width = if has_sums { width } else { 0 };
        let sums = &mut saved.0;
        sums.clear();
        sums.resize(count.div_ceil(PIECE) * width, T::Wide::ZERO);
        let pull = Pull { model: self.model, columns: &columns, lamps: &lamps, upstream };
        for_each_piece(0..count, Written { parts, sums: (width, sums) }, &|rows, written| {
            pulp::Arch::new().dispatch(
                #[inline(always)]
                || pull.back(rows, written, fresh),
            );
        });
        let inputs: SmallVec<[usize; MOST_PARTS]> = all.iter().map(|&(i, _)| i).collect();
        let uniform: SmallVec<[(usize, usize); MOST_PARTS]> = all
            .iter()
            .filter_map(|&(i, column)| {
                column.map(|own| (i, if own.is_uniform { own.width } else { 0 }))
            })
            .collect();
        for (taken, i) in taken.into_iter().zip(inputs) {
            if let Some(taken) = taken {
                gradients.put_back(i, taken);
            }
        }
        if !has_sums {
            return;
        }
        // Pieces in their order.
        let length = width.min(sums.len());
        let (totals, rest) = sums.split_at_mut(length);
        for piece in rest.chunks_exact(width) {
            totals.iter_mut().zip(piece).for_each(|(total, &sum)| *total += sum);
        }
        if totals.is_empty() {
            // No rows: what is wanted gets zeros.
            sums.resize(width, T::Wide::ZERO);
        }
        let mut start = 0;
        for (i, own) in uniform {
            let starts_at = match i {
                0 => 0,
                1 => 3,
                2 if self.has_points => 6,
                _ => SUMS_OF_GEOMETRY + start,
            };
            if i >= first {
                start += M::PARTS[i - first].1;
            }
            if own > 0
                && let Some(bar) = gradients.get(i)
            {
                bar.add_each(|k| T::narrow(sums[starts_at + k]));
            }
        }
        let sums = &sums[SUMS_OF_GEOMETRY + K..];
        for ((_, place, strength), (lamp, sums)) in
            self.light_inputs().zip(lamps.iter().zip(sums.chunks_exact(SUMS_OF_LIGHT)))
        {
            if let Some(bar) = place.and_then(|i| gradients.get(i)) {
                let mut own = [sums[0], sums[1], sums[2]];
                if lamp.kind == Kind::Directional {
                    own = pull_back_unit(lamp.place.map(T::widen), lamp.length.widen(), own);
                }
                bar.add_each(|k| T::narrow(own[k]));
            }
            if let Some(bar) = gradients.get(strength) {
                bar.add_each(|k| T::narrow(sums[3 + k]));
            }
        }
    }
}

/// The radiance of a block's rows, and whether no point light is too close.
#[inline(always)]
fn lit<T: Scalar, M: Model<K>, const K: usize>(
    model: M,
    block: &Block<T, K>,
    lamps: &[Lamp<T>],
) -> (Lanes<T, 3>, bool) {
    let mut radiance = [[T::ZERO; BLOCK]; 3];
    let mut is_good = true;
    for lamp in lamps {
        let strength = lamp.strength;
        match lamp.kind {
            Kind::Directional => {
                for k in 0..BLOCK {
                    let (n, v, material) = block.surface(k);
                    let value = model.reflect(n, v, lamp.place, material);
                    add_row(&mut radiance, k, times(strength, value));
                }
            }
            Kind::Point => {
                for k in 0..BLOCK {
                    let (n, v, material) = block.surface(k);
                    let (l, _, inverse) = lamp.seen_from(row(&block.positions, k));
                    is_good &= inverse.is_finite();
                    let value = model.reflect(n, v, l, material);
                    add_row(&mut radiance, k, times(strength.map(|own| own * inverse), value));
                }
            }
            Kind::Ambient => {
                for k in 0..BLOCK {
                    let (n, v, material) = block.surface(k);
                    add_row(&mut radiance, k, times(strength, model.ambient(n, v, material)));
                }
            }
        }
    }
    (radiance, is_good)
}

#[inline(always)]
fn times<T: Scalar>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

/// What a backward pass reads.
struct Pull<'a, 'b, T, M> {
    model: M,
    columns: &'a Columns<'b, T>,
    lamps: &'a [Lamp<T>],
    upstream: Column<'a, T>,
}

impl<T: Scalar, M> Pull<'_, '_, T, M> {
    /// Writes what a piece's rows give.
    #[inline(always)]
    fn back<const K: usize>(
        &self,
        rows: Range<usize>,
        mut written: Written<'_, T>,
        fresh: [bool; MOST_PARTS],
    ) where
        M: Model<K>,
    {
        let mut start = rows.start;
        while start < rows.end {
            let own = start..(start + BLOCK).min(rows.end);
            let at = start - rows.start..own.end - rows.start;
            start = own.end;
            self.block(own, at, &mut written, fresh);
        }
    }

    #[inline(always)]
    fn block<const K: usize>(
        &self,
        rows: Range<usize>,
        at: Range<usize>,
        written: &mut Written<'_, T>,
        fresh: [bool; MOST_PARTS],
    ) where
        M: Model<K>,
    {
        let count = rows.len();
        let mut bars: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        self.upstream.load(&rows, &mut bars);
        for lane in &mut bars {
            lane[count..].fill(T::ZERO);
        }
        let (block, _) = self.columns.load::<K>(rows);
        let mut normal_bars: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        let mut view_bars: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        let mut position_bars: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        let mut material_bars: Lanes<T, K> = [[T::ZERO; BLOCK]; K];
        let mut place_bars: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        let mut strength_bars: Lanes<T, 3> = [[T::ZERO; BLOCK]; 3];
        let (sums_width, sums) = &mut written.sums;
        for (light, lamp) in self.lamps.iter().enumerate() {
            let (model, strength) = (self.model, lamp.strength);
            // A loop for each kind: a choice inside would not become vectors.
            match lamp.kind {
                Kind::Ambient => {
                    for k in 0..BLOCK {
                        let (n, v, material) = block.surface(k);
                        let bar = row(&bars, k);
                        let found = model.pull_back_ambient(n, v, material, times(bar, strength));
                        add_row(&mut normal_bars, k, found.normal_bar);
                        add_row(&mut view_bars, k, found.view_bar);
                        add_row(&mut material_bars, k, found.material_bar);
                        set_row(&mut strength_bars, k, times(bar, found.value));
                    }
                }
                Kind::Directional => {
                    for k in 0..BLOCK {
                        let (n, v, material) = block.surface(k);
                        let bar = row(&bars, k);
                        let found =
                            model.pull_back(n, v, lamp.place, material, times(bar, strength));
                        add_row(&mut normal_bars, k, found.normal_bar);
                        add_row(&mut view_bars, k, found.view_bar);
                        add_row(&mut material_bars, k, found.material_bar);
                        set_row(&mut place_bars, k, found.light_bar);
                        set_row(&mut strength_bars, k, times(bar, found.value));
                    }
                }
                Kind::Point => {
                    for k in 0..BLOCK {
                        let (n, v, material) = block.surface(k);
                        let (l, distance, inverse) = lamp.seen_from(row(&block.positions, k));
                        let bar = row(&bars, k).map(|bar| bar * inverse);
                        let strong = times(bar, strength);
                        let found = model.pull_back(n, v, l, material, strong);
                        // The light falls as 1 / r^2: its slope is -2 / r.
                        let fall = T::from_f64(-2.0) * dot(strong, found.value) / distance;
                        let along = pull_back_unit(l, distance, found.light_bar);
                        let place_bar = plus(along, fall, l);
                        add_row(&mut normal_bars, k, found.normal_bar);
                        add_row(&mut view_bars, k, found.view_bar);
                        add_row(&mut material_bars, k, found.material_bar);
                        add_row(&mut position_bars, k, place_bar.map(|bar| -bar));
                        set_row(&mut place_bars, k, place_bar);
                        set_row(&mut strength_bars, k, times(bar, found.value));
                    }
                }
            }
            if *sums_width > 0 {
                let first = SUMS_OF_GEOMETRY + K + SUMS_OF_LIGHT * light;
                add_totals(&place_bars, count, &mut sums[first..]);
                add_totals(&strength_bars, count, &mut sums[first + 3..]);
            }
        }
        for (bars, units, lengths) in [
            (&mut normal_bars, &block.normals, &block.normal_lengths),
            (&mut view_bars, &block.views, &block.view_lengths),
        ] {
            for k in 0..BLOCK {
                let bar = pull_back_unit(row(units, k), lengths[0][k], row(bars, k));
                set_row(bars, k, bar);
            }
        }
        if *sums_width > 0 {
            add_totals(&view_bars, count, &mut sums[3..]);
            add_totals(&material_bars, count, &mut sums[SUMS_OF_GEOMETRY..]);
        }
        let mut first = 0;
        for (part, (width, entries)) in written.parts.iter_mut().enumerate() {
            let lanes = match part {
                0 => &normal_bars[..],
                1 => &view_bars[..],
                2 => &position_bars[..],
                _ => {
                    let Some(&(_, width)) = M::PARTS.get(part - 3) else { break };
                    first += width;
                    &material_bars[first - width..first]
                }
            };
            if *width > 0 {
                store(lanes, &mut entries[at.start * *width..at.end * *width], fresh[part]);
            }
        }
    }
}

/// Adds the sums over the first `count` rows.
#[inline(always)]
fn add_totals<T: Scalar>(lanes: &[[T; BLOCK]], count: usize, totals: &mut [T::Wide]) {
    for (lane, total) in lanes.iter().zip(totals) {
        let (whole, rest) = lane[..count].as_chunks::<8>();
        let mut parts = [T::Wide::ZERO; 8];
        for chunk in whole {
            for i in 0..8 {
                parts[i] += chunk[i].widen();
            }
        }
        let sum: T::Wide = parts.into_iter().sum();
        let rest: T::Wide = rest.iter().map(|entry| entry.widen()).sum();
        *total += sum + rest;
    }
}
