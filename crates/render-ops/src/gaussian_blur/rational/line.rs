//! A line of pixels, blurred by tridiagonal systems: the recurrences and their coefficients.

use bokashi_core::Scalar;

use super::complex::Complex;
use super::poles::Order;
use crate::border::Border;

/// Lines that are solved side by side.
pub(super) const LANES: usize = 32;

/// An entry of each of several lines, on cache lines of its own.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Lanes<T>(pub(super) [T; LANES]);

impl<T: Scalar> Lanes<T> {
    const ZERO: Self = Self([T::ZERO; LANES]);

    /// Sets the first lanes to `entries`, the others to zero.
    #[inline(always)]
    pub(super) fn put(&mut self, entries: &[T]) {
        match entries.try_into() {
            Ok(entries) => self.0 = entries,
            Err(_) => {
                self.0 = [T::ZERO; LANES];
                self.0[..entries.len()].copy_from_slice(entries);
            }
        }
    }
}

/// A complex entry of each of several lines: real parts, imaginary parts.
type ComplexLanes<T> = [Lanes<T>; 2];

/// Several lines, and memory.
#[derive(Debug, Default)]
pub(crate) struct Block<T> {
    /// The lines; then the lines blurred.
    pub(super) lines: Vec<Lanes<T>>,
    /// The lines' derivatives with respect to sigma; then the blurred lines' derivatives.
    pub(super) slopes: Vec<Lanes<T>>,
    /// Right sides of the systems of lines and derivatives.
    sides: [Vec<Lanes<T>>; 2],
    /// A solution, as far as it is known.
    partial: Vec<ComplexLanes<T>>,
}

impl<T: Scalar> Block<T> {
    /// How many entries there is memory for.
    pub(crate) fn len(&self) -> usize {
        let Self { lines, slopes, sides: [sides, more], partial } = self;
        (lines.len() + slopes.len() + sides.len() + more.len() + 2 * partial.len()) * LANES
    }
}

/// What is done to lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Task {
    /// They are blurred.
    Blur,
    /// They are blurred, with slopes; the lines themselves don't depend on sigma.
    BlurWithSlopes,
    /// They are blurred, with slopes; the lines depend on sigma, and their slopes are blurred, too.
    BlurBoth,
}

/// A blur of lines of one length.
#[derive(Debug, Default)]
pub(crate) struct Line<T> {
    positions: usize,
    /// Whether the lines go on mirrored.
    mirror: bool,
    /// The share of a line that is left at the highest frequencies.
    remainder: T,
    /// `2 / sigma`.
    two_by_sigma: T,
    poles: Vec<Pole<T>>,
}

/// The system of one pole.
#[derive(Debug)]
struct Pole<T> {
    /// `loss_i = 1 + h / p_(i-1)` for pivots p: an elimination step multiplies by `1 - loss_i`,
    /// which is 0 at both ends. The loss is stored because a factor near 1 would lose digits.
    losses: Vec<[T; 2]>,
    /// `c / p_i`.
    scales: Vec<[T; 2]>,
    /// What sigma's slope adds to the right side, in the line and at its ends.
    by_sigma: [T; 2],
    by_sigma_at_end: [T; 2],
}

impl<T: Scalar> Pole<T> {
    fn empty() -> Self {
        let zero = [T::ZERO; 2];
        Self { losses: Vec::new(), scales: Vec::new(), by_sigma: zero, by_sigma_at_end: zero }
    }

    /// The system of the pole `z` with residue `z g` over n positions.
    fn fill(
        &mut self,
        z: Complex<T::Wide>,
        g: Complex<T::Wide>,
        sigma: T::Wide,
        mirror: bool,
        n: usize,
    ) {
        let number = |x: f64| Complex::real(T::Wide::from_f64(x));
        let (one, zero) = (number(1.0), number(0.0));
        let h = Complex::real(sigma * sigma) * number(0.5);
        let a = z / h;
        // Pivots are `-h (1 + d)`. Along the line `1 + d` approaches 1 / q: the root of
        // `q + 1/q - 2 = a` outside the unit circle.
        let middle = one + a * number(0.5);
        let root = (a * a + number(4.0) * a).sqrt() * number(0.5);
        let same_side = middle.re * root.re + middle.im * root.im >= T::Wide::ZERO;
        let limit = a * number(0.5) + if same_side { root } else { zero - root };
        let ratio = one / (one + limit);
        self.losses.clear();
        self.scales.clear();
        self.losses.push(one.narrow());
        // `-2 c / h` for the residue.
        let scale = number(-2.0) * g * a;
        // `d / (1 + d)` at the position before.
        let mut before = if mirror { zero } else { limit * ratio };
        for _ in 1..n {
            let d = a + before;
            let ratio = one / (one + d);
            before = d * ratio;
            self.losses.push(before.narrow());
            self.scales.push((scale * ratio).narrow());
        }
        // The last pivot is `-h d` for a mirror, else `-h (1 + d - q)`.
        let last = a + before + if mirror { zero } else { one - ratio };
        self.scales.push((scale / last).narrow());
        self.losses.push(one.narrow());
        // `-2 z / (sigma c)` with `c = 2 g z`.
        let by_sigma = number(-1.0) / (g * Complex::real(sigma));
        let at_end = if mirror { one } else { one / (one - ratio * ratio) };
        // A line of one position has both ends there.
        let at_end = if n == 1 { at_end + at_end - one } else { at_end };
        self.by_sigma = by_sigma.narrow();
        self.by_sigma_at_end = (by_sigma * at_end).narrow();
    }
}

impl<T: Scalar> Line<T> {
    /// Fills in the blur by `order` with standard deviation `sigma`, in pixels, of lines of `extent`
    /// pixels.
    pub(crate) fn fill(&mut self, order: &Order, sigma: T, border: Border, extent: usize) {
        self.positions = extent;
        self.mirror = border == Border::Mirror;
        let remainder = 1.0 + 2.0 * order.poles.iter().map(|[_, [re, _]]| re).sum::<f64>();
        self.remainder = T::from_f64(remainder);
        self.two_by_sigma = T::narrow(T::Wide::from_f64(2.0) / sigma.widen());
        self.poles.resize_with(order.poles.len(), Pole::empty);
        for (pole, parts) in self.poles.iter_mut().zip(order.poles) {
            let [z, g] = parts.map(|[re, im]| {
                let number = T::Wide::from_f64;
                Complex { re: number(re), im: number(im) }
            });
            pole.fill(z, g, sigma.widen(), self.mirror, self.positions);
        }
    }

    /// Makes room for the lines' pixels.
    #[inline(always)]
    pub(super) fn start(&self, block: &mut Block<T>, task: Task) {
        block.partial.resize(self.positions, [Lanes::ZERO; 2]);
        let moving = if task == Task::Blur { 1 } else { 2 };
        let pictures = [&mut block.lines, &mut block.slopes].into_iter().zip(&mut block.sides);
        for (lines, sides) in pictures.take(moving) {
            lines.resize(self.positions, Lanes::ZERO);
            sides.resize(self.positions, Lanes::ZERO);
        }
    }

    /// Does `task` to the lines of `block`.
    #[inline(always)]
    pub(super) fn solve(&self, block: &mut Block<T>, task: Task) {
        let Block { lines, slopes, sides: [sides, sides_of_slopes], partial } = block;
        let base = if self.mirror { nearest_to_zero(lines) } else { Lanes::ZERO };
        for (line, side) in lines.iter_mut().zip(&mut *sides) {
            *side = difference(line, &base);
            *line = sum_of(&base, &scaled(self.remainder, side));
        }
        if task != Task::Blur {
            let systems = slopes.iter_mut().zip(sides_of_slopes.iter_mut()).zip(&*sides);
            for ((slope, side_of_slope), side) in systems {
                if task == Task::BlurWithSlopes {
                    *slope = Lanes::ZERO;
                }
                *side_of_slope = difference(slope, &scaled(self.two_by_sigma, side));
                *slope = scaled(self.remainder, slope);
            }
        }
        for pole in &self.poles {
            pole.eliminate(sides, partial);
            if task == Task::Blur {
                pole.substitute(partial, lines);
            } else {
                // One walk ends the lines' system and begins that of the slopes.
                pole.substitute_and_eliminate(partial, lines, sides_of_slopes);
                pole.substitute_slopes(partial, slopes);
            }
        }
    }
}

/// The entry of each line that is nearest to zero, or zero where a line has entries of both signs.
#[inline(always)]
fn nearest_to_zero<T: Scalar>(lines: &[Lanes<T>]) -> Lanes<T> {
    let (mut least, mut most) = (lines[0], lines[0]);
    for line in lines {
        for k in 0..LANES {
            let entry = line.0[k];
            least.0[k] = if entry < least.0[k] { entry } else { least.0[k] };
            most.0[k] = if entry > most.0[k] { entry } else { most.0[k] };
        }
    }
    let mut nearest = Lanes::ZERO;
    for k in 0..LANES {
        let below = if most.0[k] < T::ZERO { most.0[k] } else { T::ZERO };
        nearest.0[k] = if least.0[k] > T::ZERO { least.0[k] } else { below };
    }
    nearest
}

impl<T: Scalar> Pole<T> {
    /// `u_i = f_i + (1 - loss_i) u_(i-1)`.
    #[inline(always)]
    fn eliminate(&self, f: &[Lanes<T>], u: &mut [ComplexLanes<T>]) {
        let mut state = [Lanes::ZERO; 2];
        for ((&loss, f), u) in self.losses.iter().zip(f).zip(u) {
            let [re, im] = less(loss, &state);
            state = [sum_of(&re, f), im];
            *u = state;
        }
    }

    /// `v_i = scale_i u_i + (1 - loss_(i+1)) v_(i+1)`, whose real part is added to `sums`.
    #[inline(always)]
    fn substitute(&self, u: &[ComplexLanes<T>], sums: &mut [Lanes<T>]) {
        let mut v = [Lanes::ZERO; 2];
        let factors = self.scales.iter().zip(&self.losses[1..]);
        for (((&scale, &loss), u), sum) in factors.zip(u).zip(sums).rev() {
            v = add(&product(scale, u), &less(loss, &v));
            *sum = sum_of(sum, &v[0]);
        }
    }

    /// The same, and in the same loop the elimination of the slopes' system, from the other end:
    /// `s_i = f_i + by_sigma v_i + (1 - loss_(n-1-i)) s_(i+1)`, which replaces u.
    #[inline(always)]
    fn substitute_and_eliminate(
        &self,
        u: &mut [ComplexLanes<T>],
        sums: &mut [Lanes<T>],
        f: &[Lanes<T>],
    ) {
        let (mut v, mut s) = ([Lanes::ZERO; 2], [Lanes::ZERO; 2]);
        let n = sums.len();
        for i in (0..n).rev() {
            v = add(&product(self.scales[i], &u[i]), &less(self.losses[i + 1], &v));
            sums[i] = sum_of(&sums[i], &v[0]);
            let is_end = i == 0 || i == n - 1;
            let by_sigma = if is_end { self.by_sigma_at_end } else { self.by_sigma };
            let [re, im] = add(&product(by_sigma, &v), &less(self.losses[n - 1 - i], &s));
            s = [sum_of(&re, &f[i]), im];
            u[i] = s;
        }
    }

    /// `w_i = scale_(n-1-i) s_i + (1 - loss_(n-i)) w_(i-1)`, whose real part is added to `sums`.
    #[inline(always)]
    fn substitute_slopes(&self, s: &[ComplexLanes<T>], sums: &mut [Lanes<T>]) {
        let mut w = [Lanes::ZERO; 2];
        let factors = self.scales.iter().zip(&self.losses[1..]).rev();
        for (((&scale, &loss), s), sum) in factors.zip(s).zip(sums) {
            w = add(&product(scale, s), &less(loss, &w));
            *sum = sum_of(sum, &w[0]);
        }
    }
}

/// `factor x`.
#[inline(always)]
fn product<T: Scalar>([a, b]: [T; 2], [re, im]: &ComplexLanes<T>) -> ComplexLanes<T> {
    let mut product = [Lanes::ZERO; 2];
    for k in 0..LANES {
        product[0].0[k] = a * re.0[k] - b * im.0[k];
        product[1].0[k] = a * im.0[k] + b * re.0[k];
    }
    product
}

/// `x - loss x`.
#[inline(always)]
fn less<T: Scalar>(loss: [T; 2], x: &ComplexLanes<T>) -> ComplexLanes<T> {
    let [re, im] = product(loss, x);
    [difference(&x[0], &re), difference(&x[1], &im)]
}

#[inline(always)]
fn add<T: Scalar>(x: &ComplexLanes<T>, y: &ComplexLanes<T>) -> ComplexLanes<T> {
    [sum_of(&x[0], &y[0]), sum_of(&x[1], &y[1])]
}

#[inline(always)]
fn sum_of<T: Scalar>(x: &Lanes<T>, y: &Lanes<T>) -> Lanes<T> {
    let mut sum = Lanes::ZERO;
    for k in 0..LANES {
        sum.0[k] = x.0[k] + y.0[k];
    }
    sum
}

#[inline(always)]
fn difference<T: Scalar>(x: &Lanes<T>, y: &Lanes<T>) -> Lanes<T> {
    let mut difference = Lanes::ZERO;
    for k in 0..LANES {
        difference.0[k] = x.0[k] - y.0[k];
    }
    difference
}

#[inline(always)]
fn scaled<T: Scalar>(factor: T, x: &Lanes<T>) -> Lanes<T> {
    let mut product = Lanes::ZERO;
    for k in 0..LANES {
        product.0[k] = factor * x.0[k];
    }
    product
}
