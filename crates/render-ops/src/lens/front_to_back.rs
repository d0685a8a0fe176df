//! What a lens sees of blurred rungs.
//!
//! # Forward
//! Rung k, from the nearest on, has at a pixel the blurred colours `C_k` and the blurred alpha `A_k`. With g of
//! `hiding`, `F_k = sum_(m < k - 1) g(rho_m, rho_k) v_m` is what hides it, and
//! `v_k = min(A_k h(1 - F_k), 1 - sum_(m < k) v_m)` what is seen of it, as long as something is left of both. With
//! `q_k = v_k / A_k`, which is `h(1 - F_k)` where A is 0, the picture is `o = sum_k q_k C_k / V`, `V = sum_k v_k`.
//! What is nearly hidden is hidden, `h(u) = u^2 (1 + e) / (u + e)` with e = 0.01: along a slope the alphas of its
//! rungs add up to 1 but for a few hundredths, and the rest would leak.
//!
//! Rungs near each other add up: they are one surface, cut into rungs. Rungs apart lie over one another: what
//! they cover of the lens is independent.
//!
//! Where the lens is full nothing more is seen: a rung behind is not even blurred where all pixels are full. The
//! rungs far in front of rung k, with g = 1, are those before some rung, which moves back with k. So they are
//! summed once.
//!
//! # Backward
//! With `b = o_bar / V` and `V_bar = -o . b`, from the last rung to the first, with `q_bar = b . C_k` and
//! `v_bar = V_bar` and what later rungs have added: `C_bar_k = q_k b`. Where the first argument of min was
//! taken, q is `h(u)`, `u = 1 - F_k`: `A_bar_k = q v_bar`, `F_bar = -(q_bar + A_k v_bar) h'(u)`, and
//! `v_bar_m += g F_bar`. `h' = (1 + e) u (u + 2 e) / (u + e)^2`, with u the root of `h(u) = q`.
//! Where the second was: `v_bar += q_bar / A_k`, `A_bar_k = -q_bar q_k / A_k`, and `v_bar_m -= v_bar` for all
//! `m < k`. Where nothing is seen: nothing.
//!
//! # Where it is not smooth
//! Where min changes sides. Both sides are equal on whole surfaces, where alphas add up to 1, and so are their
//! derivatives there.

use std::ops::Range;

use bokashi_core::Scalar;

use super::hiding::gap;
use crate::defocus::{Part, Rungs, Strip};

/// g between all rungs.
#[derive(Debug, Default)]
pub(super) struct Gaps {
    values: Vec<f64>,
    count: usize,
}

impl Gaps {
    pub(super) fn update(&mut self, rungs: &Rungs) {
        let count = rungs.count();
        if self.count != count {
            self.count = count;
            self.values.clear();
            for k in 0..count {
                let to = rungs.radius(k);
                // Neighbours are of one surface.
                let hides = |m: usize| if m + 1 < k { gap(rungs.radius(m), to).share } else { 0.0 };
                self.values.extend((0..count).map(hides));
            }
        }
    }

    /// How much of rung `k` rung `m` hides.
    fn hidden_share(&self, m: usize, k: usize) -> f64 {
        self.values[k * self.count + m]
    }
}

/// What is left of the lens is rounding, where it is less.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// How full the lens is at each pixel of a part of the picture, while its rungs are put together.
#[derive(Debug)]
pub(super) struct LensState<T> {
    part: Part,
    /// `sum v`.
    pub(super) total: Vec<T>,
    /// `sum v` of the rungs far in front.
    far: Vec<T>,
    /// How many of the rungs so far are far in front.
    passed: usize,
    /// For each rung so far its v, and its q as `see` gives it, as its strip lies.
    seen: Vec<Vec<T>>,
    shares: Vec<Vec<T>>,
    /// F of a row.
    hidden: Vec<T>,
    /// Backward, `V_bar` and what is taken from all rungs in front; and what is taken from those far in front.
    total_bar: Vec<T>,
    far_bar: Vec<T>,
    /// For each rung the dot products `o_bar . C_k`, then `v_bar`; and how many rungs are far in front of it.
    dots: Vec<Vec<T>>,
    seen_bars: Vec<Vec<T>>,
    passed_before: Vec<usize>,
}

impl<T> Default for LensState<T> {
    fn default() -> Self {
        Self {
            part: [0..0, 0..0],
            total: Vec::new(),
            far: Vec::new(),
            passed: 0,
            seen: Vec::new(),
            shares: Vec::new(),
            hidden: Vec::new(),
            total_bar: Vec::new(),
            far_bar: Vec::new(),
            dots: Vec::new(),
            seen_bars: Vec::new(),
            passed_before: Vec::new(),
        }
    }
}

/// Makes a list of so many zeros.
fn zeros<T: Scalar>(list: &mut Vec<T>, length: usize) {
    list.clear();
    list.resize(length, T::ZERO);
}

/// How much is seen of a rung at a pixel, v, and its share, q, below 0 where what is left decides.
#[inline(always)]
fn see<T: Scalar>(alpha: T, hidden: T, total: T, rounding: T) -> [T; 2] {
    let (unhidden, left) = (T::ONE - hidden, T::ONE - total);
    let through = through(unhidden);
    let wanted = alpha * through;
    // What adds light and hides nothing has an alpha of 0.
    let is_seen = unhidden > T::ZERO && left > rounding;
    let is_hidden = wanted <= left;
    let seen = if is_hidden { wanted } else { left };
    let share = if is_hidden { through } else { -(left / alpha) };
    if is_seen { [seen, share] } else { [T::ZERO; 2] }
}

/// e.
const LEAK: f64 = 0.01;

/// `h(u)`, for u above 0.
#[inline(always)]
fn through<T: Scalar>(unhidden: T) -> T {
    let leak = T::from_f64(LEAK);
    unhidden * unhidden * (T::ONE + leak) / (unhidden + leak)
}

/// `h'(u)` where `h(u)` is `through`.
#[inline(always)]
fn through_slope<T: Scalar>(through: T) -> T {
    let (leak, scale) = (T::from_f64(LEAK), T::from_f64(1.0 + LEAK));
    let root = (through * (through + T::from_f64(4.0) * scale * leak)).sqrt();
    let unhidden = T::from_f64(0.5) * (through + root) / scale;
    let sum = unhidden + leak;
    scale * unhidden * (sum + leak) / (sum * sum)
}

#[inline(always)]
fn size<T: Scalar>(x: T) -> T {
    if x < T::ZERO { -x } else { x }
}

impl<T: Scalar> LensState<T> {
    /// Begins with nothing that is seen of a part of the picture.
    pub(super) fn begin(&mut self, part: &Part) {
        self.part = part.clone();
        let pixels = part[0].len() * part[1].len();
        zeros(&mut self.total, pixels);
        zeros(&mut self.far, pixels);
        self.passed = 0;
        self.passed_before.clear();
    }

    /// Where some columns of a row stand.
    #[inline(always)]
    fn range(&self, row: usize, columns: &Range<usize>) -> Range<usize> {
        let start = (row - self.part[0].start) * self.part[1].len() + columns.start;
        let start = start - self.part[1].start;
        start..start + columns.len()
    }

    /// The columns between which something is left of the lens.
    pub(super) fn unfilled(&self) -> Range<usize> {
        let [_, columns] = &self.part;
        let (width, full) = (columns.len(), T::ONE - T::from_f64(ROUNDING));
        let (mut first, mut end) = (width, 0);
        for row in self.total.chunks_exact(width.max(1)) {
            let is_left = |total: &T| *total < full;
            first = row[..first].iter().position(is_left).unwrap_or(first);
            let last = row[end..].iter().rposition(is_left);
            end = last.map_or(end, |last| end + last + 1);
        }
        if first < end { columns.start + first..columns.start + end } else { 0..0 }
    }

    /// Finds what is seen of the last of `strips`, after those before it; adds its colours to `out`, whose
    /// channels are interleaved.
    pub(super) fn add(&mut self, strips: &[Strip<T>], gaps: &Gaps, channels: usize, out: &mut [T]) {
        crate::dispatch::dispatch_256::<T, _>(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let out = out;
                self.add_strip(strips, gaps, channels, out);
            },
        );
    }

    #[inline(always)]
    fn add_strip(&mut self, strips: &[Strip<T>], gaps: &Gaps, channels: usize, out: &mut [T]) {
        let Some((strip, before)) = strips.split_last() else { return };
        self.pass(strips, gaps);
        let index = before.len();
        for list in [&mut self.seen, &mut self.shares] {
            list.resize_with(list.len().max(index + 1), Vec::new);
        }
        let mut own =
            [&mut self.seen, &mut self.shares].map(|list| std::mem::take(&mut list[index]));
        own.iter_mut().for_each(|list| list.resize(strip.plane(), T::ZERO));
        let [own_seen, own_shares] = &mut own;
        let rounding = T::from_f64(ROUNDING);
        let columns = &strip.columns;
        let count = columns.len();
        for row in strip.rows.clone() {
            self.hide(before, gaps, strip, row);
            let range = self.range(row, columns);
            let start = strip.offset(row, columns.start);
            let seen = &mut own_seen[start..start + count];
            let shares = &mut own_shares[start..start + count];
            let alphas = strip.row(channels, row, columns.clone());
            let (total, hidden) = (&mut self.total[range.clone()], &self.hidden[..count]);
            for x in 0..count {
                let [v, q] = see(alphas[x], hidden[x], total[x], rounding);
                (seen[x], shares[x]) = (v, q);
                total[x] += v;
            }
            if out.is_empty() {
                continue;
            }
            let out = &mut out[range.start * channels..range.end * channels];
            for channel in 0..channels {
                let colors = strip.row(channel, row, columns.clone());
                for x in 0..count {
                    out[x * channels + channel] += size(shares[x]) * colors[x];
                }
            }
        }
        [self.seen[index], self.shares[index]] = own;
    }

    /// Lets those rungs pass that are far in front of the last one.
    #[inline(always)]
    fn pass(&mut self, strips: &[Strip<T>], gaps: &Gaps) {
        let Some((strip, before)) = strips.split_last() else { return };
        while self.passed < before.len()
            && gaps.hidden_share(before[self.passed].rung, strip.rung) >= 1.0
        {
            let other = &before[self.passed];
            for row in other.rows.clone() {
                let range = self.range(row, &other.columns);
                let seen = &self.seen[self.passed][other.offset(row, other.columns.start)..];
                let far = &mut self.far[range];
                for x in 0..far.len() {
                    far[x] += seen[x];
                }
            }
            self.passed += 1;
        }
        self.passed_before.push(self.passed);
    }

    /// F of a row of a strip, in `hidden`.
    #[inline(always)]
    fn hide(&mut self, before: &[Strip<T>], gaps: &Gaps, strip: &Strip<T>, row: usize) {
        let columns = &strip.columns;
        let range = self.range(row, columns);
        self.hidden.clear();
        self.hidden.extend_from_slice(&self.far[range]);
        let passed = self.passed_before[before.len()];
        for (other, seen) in before.iter().zip(&self.seen).skip(passed) {
            let gap = gaps.hidden_share(other.rung, strip.rung);
            let common = common(&other.columns, columns);
            if gap <= 0.0 || common.is_empty() {
                continue;
            }
            let gap = T::from_f64(gap);
            let seen = &seen[other.offset(row, common.start)..][..common.len()];
            let hidden = &mut self.hidden[common.start - columns.start..][..common.len()];
            for x in 0..hidden.len() {
                hidden[x] += gap * seen[x];
            }
        }
    }

    /// A number that tells on which smooth piece the strips lie that were added.
    pub(super) fn piece(&self, strips: &[Strip<T>], gaps: &Gaps, channels: usize) -> u64 {
        let mut state = Self::default();
        state.begin(&self.part);
        let mut piece = 0_u64;
        for (index, strip) in strips.iter().enumerate() {
            let total = state.total.clone();
            state.add(&strips[..=index], gaps, channels, &mut []);
            for row in strip.rows.clone() {
                state.hide(&strips[..index], gaps, strip, row);
                let alphas = strip.row(channels, row, strip.columns.clone());
                let range = state.range(row, &strip.columns);
                for ((&alpha, &hidden), &total) in
                    alphas.iter().zip(&state.hidden).zip(&total[range])
                {
                    let (one, zero) = (T::ONE, T::ZERO);
                    let (unhidden, left) = (one - hidden, one - total);
                    let is_seen = unhidden > zero && left > T::from_f64(ROUNDING);
                    // Where both arguments are equal rounding decides, and the slopes are equal, too.
                    let is_cut = alpha * through(unhidden) - left > T::from_f64(ROUNDING);
                    let place = u64::from(is_seen) + 2 * u64::from(is_cut) + 5 * strip.rung as u64;
                    piece = (piece ^ place).wrapping_mul(0x0100_0000_01b3);
                }
            }
        }
        piece
    }

    /// The gradients of `strips`, all that were added, in `bars` of the same form: of the gradient `out_bar` of
    /// the picture, whose channels are interleaved.
    pub(super) fn pull_back(
        &mut self,
        strips: &[Strip<T>],
        gaps: &Gaps,
        out_bar: &[T],
        bars: &mut [Strip<T>],
    ) {
        crate::dispatch::dispatch_256::<T, _>(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let bars = bars;
                self.pull_back_strips(strips, gaps, out_bar, bars);
            },
        );
    }

    #[inline(always)]
    fn pull_back_strips(
        &mut self,
        strips: &[Strip<T>],
        gaps: &Gaps,
        out_bar: &[T],
        bars: &mut [Strip<T>],
    ) {
        let part = self.part.clone();
        let channels = out_bar.len() / (part[0].len() * part[1].len());
        self.begin(&part);
        zeros(&mut self.total_bar, out_bar.len() / channels);
        zeros(&mut self.far_bar, out_bar.len() / channels);
        for list in [&mut self.dots, &mut self.seen_bars] {
            list.resize_with(list.len().max(strips.len()), Vec::new);
        }
        for index in 0..strips.len() {
            self.add_strip(&strips[..=index], gaps, channels, &mut []);
            self.dot(&strips[index], index, channels, out_bar);
        }
        for (bar, &total) in self.total_bar.iter_mut().zip(&self.total) {
            *bar = if total > T::ZERO { *bar / (total * total) } else { T::ZERO };
        }
        for index in (0..strips.len()).rev() {
            self.pull_back_strip(strips, index, gaps, out_bar, &mut bars[index]);
        }
    }

    /// The dot products of a strip's colours; takes `V^2 V_bar` from `total_bar`.
    #[inline(always)]
    fn dot(&mut self, strip: &Strip<T>, index: usize, channels: usize, out_bar: &[T]) {
        let columns = &strip.columns;
        let count = columns.len();
        let mut dots = std::mem::take(&mut self.dots[index]);
        zeros(&mut dots, strip.plane());
        zeros(&mut self.seen_bars[index], strip.plane());
        for row in strip.rows.clone() {
            let range = self.range(row, columns);
            let start = strip.offset(row, columns.start);
            let dots = &mut dots[start..start + count];
            let out_bar = &out_bar[range.start * channels..range.end * channels];
            for channel in 0..channels {
                let colors = strip.row(channel, row, columns.clone());
                for x in 0..count {
                    dots[x] += out_bar[x * channels + channel] * colors[x];
                }
            }
            let shares = &self.shares[index][start..start + count];
            let sum = &mut self.total_bar[range];
            for x in 0..count {
                sum[x] -= size(shares[x]) * dots[x];
            }
        }
        self.dots[index] = dots;
    }

    #[inline(always)]
    fn pull_back_strip(
        &mut self,
        strips: &[Strip<T>],
        index: usize,
        gaps: &Gaps,
        out_bar: &[T],
        bar: &mut Strip<T>,
    ) {
        let (strip, before) = (&strips[index], &strips[..index]);
        let channels = strip.values.len() / strip.plane().max(1) - 1;
        let columns = strip.columns.clone();
        let count = columns.len();
        for row in strip.rows.clone() {
            let range = self.range(row, &columns);
            let start = strip.offset(row, columns.start);
            let ends = start..start + count;
            self.hidden.clear();
            self.hidden.resize(count, T::ZERO);
            // F_bar, which is 0 where F does not decide.
            let hidden_bar = &mut self.hidden[..count];
            let [dots, shares, seen_bars] =
                [&self.dots, &self.shares, &self.seen_bars].map(|list| &list[index][ends.clone()]);
            let total = &self.total[range.clone()];
            let total_bar = &mut self.total_bar[range.clone()];
            let alphas = strip.row(channels, row, columns.clone());
            let first = channels * strip.plane() + start;
            let alpha_bar = &mut bar.values[first..first + count];
            let zero = T::ZERO;
            for x in 0..count {
                let (q, alpha) = (size(shares[x]), alphas[x]);
                let is_left = shares[x] < zero;
                let is_seen = q > zero && total[x] > zero;
                let q_bar = dots[x] / total[x];
                let v_bar = total_bar[x] + seen_bars[x];
                let by_alpha = q_bar / alpha;
                let taken = if is_left { v_bar + by_alpha } else { zero };
                let bar = if is_left { -(q * by_alpha) } else { q * v_bar };
                let by_hidden = -(q_bar + alpha * v_bar) * through_slope(q);
                let hidden = if is_left { zero } else { by_hidden };
                alpha_bar[x] = if is_seen { bar } else { zero };
                hidden_bar[x] = if is_seen { hidden } else { zero };
                total_bar[x] -= if is_seen { taken } else { zero };
            }
            let out_bar = &out_bar[range.start * channels..range.end * channels];
            for channel in 0..channels {
                let first = channel * strip.plane() + start;
                let color_bar = &mut bar.values[first..first + count];
                for x in 0..count {
                    let q = size(shares[x]);
                    let is_seen = q > zero && total[x] > zero;
                    let share = if is_seen { q / total[x] } else { zero };
                    color_bar[x] = share * out_bar[x * channels + channel];
                }
            }
            self.pull_back_hiding(before, gaps, strip, row);
        }
        self.pull_back_passing(before);
    }

    /// Gives F_bar of a row of a strip to those that hide it.
    #[inline(always)]
    fn pull_back_hiding(&mut self, before: &[Strip<T>], gaps: &Gaps, strip: &Strip<T>, row: usize) {
        let columns = &strip.columns;
        let range = self.range(row, columns);
        for (far_bar, &hidden_bar) in self.far_bar[range].iter_mut().zip(&self.hidden) {
            *far_bar += hidden_bar;
        }
        let passed = self.passed_before[before.len()];
        for (other, bars) in before.iter().zip(&mut self.seen_bars).skip(passed) {
            let gap = gaps.hidden_share(other.rung, strip.rung);
            let common = common(&other.columns, columns);
            if gap <= 0.0 || common.is_empty() {
                continue;
            }
            let gap = T::from_f64(gap);
            let bars = &mut bars[other.offset(row, common.start)..][..common.len()];
            let hidden_bar = &self.hidden[common.start - columns.start..][..common.len()];
            for x in 0..bars.len() {
                bars[x] += gap * hidden_bar[x];
            }
        }
    }

    /// Gives what has been gathered to the rungs that passed just before a strip.
    #[inline(always)]
    fn pull_back_passing(&mut self, before: &[Strip<T>]) {
        let index = before.len();
        let first = index.checked_sub(1).map_or(0, |last| self.passed_before[last]);
        for passed in first..self.passed_before[index] {
            let other = &before[passed];
            for row in other.rows.clone() {
                let range = self.range(row, &other.columns);
                let start = other.offset(row, other.columns.start);
                let bars = &mut self.seen_bars[passed][start..start + range.len()];
                bars.iter_mut().zip(&self.far_bar[range]).for_each(|(bar, &far)| *bar += far);
            }
        }
    }
}

/// The columns that both have.
pub(super) fn common(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    a.start.max(b.start)..a.end.min(b.end)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rungs() -> (Rungs, Gaps) {
        let (mut rungs, mut gaps) = (Rungs::default(), Gaps::default());
        rungs.reach(12.0);
        gaps.update(&rungs);
        (rungs, gaps)
    }

    /// Strips of one pixel and one channel.
    fn strips(given: &[(usize, f64, f64)]) -> Vec<Strip<f64>> {
        let strip = |&(rung, color, alpha): &(usize, f64, f64)| Strip {
            rung,
            rows: 0..1,
            columns: 0..1,
            held: 0..1,
            values: vec![color, alpha],
        };
        given.iter().map(strip).collect()
    }

    /// The picture of rungs at a pixel, and q of each as `see` gives it.
    fn picture(given: &[(usize, f64, f64)], gaps: &Gaps) -> (f64, Vec<f64>) {
        let strips = strips(given);
        let (mut state, mut out) = (LensState::<f64>::default(), [0.0]);
        state.begin(&[0..1, 0..1]);
        (0..strips.len()).for_each(|k| state.add(&strips[..=k], gaps, 1, &mut out));
        let shares = state.shares.iter().map(|shares| shares[0]).collect();
        (out[0] / state.total[0], shares)
    }

    #[test]
    fn rungs_apart_lie_over_one_another_and_neighbours_add_up() {
        let (rungs, gaps) = rungs();
        let last = rungs.count() - 1;
        let (over, _) = picture(&[(0, 0.3 * 0.9, 0.3), (last, 0.2, 1.0)], &gaps);
        let q = 0.49 * 1.01 / 0.71;
        assert!((over - (0.27 + q * 0.2) / (0.3 + q)).abs() < 1e-15);
        let (added, _) = picture(&[(4, 0.3 * 0.9, 0.3), (5, 0.7 * 0.2, 0.7)], &gaps);
        assert!((added - (0.27 + 0.14)).abs() < 1e-15);
        // What is more than the whole lens is cut.
        let (cut, shares) = picture(&[(4, 0.8, 0.8), (5, 0.3, 0.6)], &gaps);
        assert!((cut - (0.8 + 0.2 / 0.6 * 0.3)).abs() < 1e-15);
        assert!(shares[0] > 0.0 && shares[1] < 0.0);
    }

    #[test]
    fn gradients_are_those_of_differences() {
        let (rungs, gaps) = rungs();
        let last = rungs.count() - 1;
        let given = [
            (1, 0.1, 0.35),
            (2, 0.2, 0.25),
            (9, 0.15, 0.2),
            (11, 0.1, 0.3),
            (14, 0.3, 0.6),
            (last - 1, 0.2, 0.1),
            (last, 0.4, 0.7),
        ];
        let (_, shares) = picture(&given, &gaps);
        assert!(shares.iter().any(|&q| q < 0.0) && shares.iter().filter(|&&q| q > 0.0).count() > 3);
        let strips = strips(&given);
        let (mut state, mut bars) = (LensState::<f64>::default(), strips.clone());
        state.begin(&[0..1, 0..1]);
        state.pull_back(&strips, &gaps, &[1.0], &mut bars);
        assert!(state.passed_before.iter().any(|&passed| passed > 0));
        for k in 0..given.len() {
            for entry in 0..2 {
                let picture = |step: f64| {
                    let mut moved = given;
                    *[&mut moved[k].1, &mut moved[k].2][entry] += step;
                    picture(&moved, &gaps).0
                };
                let slope = (picture(1e-6) - picture(-1e-6)) / 2e-6;
                let found = bars[k].values[entry];
                assert!((found - slope).abs() < 1e-8, "{k}, {entry}: {found} is not {slope}");
            }
        }
    }
}
