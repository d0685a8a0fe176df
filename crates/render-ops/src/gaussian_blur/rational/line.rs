//! A line of pixels, blurred by tridiagonal systems: the recurrences and their coefficients.

use bokashi_core::Scalar;

use super::complex::Complex;
use super::poles::Order;
use crate::border::Border;

/// Lines that are solved side by side.
pub(super) const LANES: usize = 32;

/// An entry of each of several lines, on lines of the cache of their own.
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
#[derive(Debug)]
pub(crate) struct Block<T> {
    /// The lines; then the lines blurred.
    pub(super) lines: Vec<Lanes<T>>,
    /// How the lines move with sigma; then how the blurred ones do.
    pub(super) slopes: Vec<Lanes<T>>,
    /// The steps from each position to the next of both.
    steps: [Vec<Lanes<T>>; 2],
    /// What is known of a solution.
    partial: Vec<ComplexLanes<T>>,
}

impl<T> Default for Block<T> {
    fn default() -> Self {
        let steps = [Vec::new(), Vec::new()];
        Self { lines: Vec::new(), slopes: Vec::new(), steps, partial: Vec::new() }
    }
}

impl<T: Scalar> Block<T> {
    /// How many entries there is memory for.
    pub(crate) fn len(&self) -> usize {
        let Self { lines, slopes, steps: [steps, more], partial } = self;
        (lines.len() + slopes.len() + steps.len() + more.len() + 2 * partial.len()) * LANES
    }
}

/// What is done to lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Task {
    /// They are blurred.
    Blur,
    /// The same, with slopes; the lines themselves don't move with sigma.
    BlurWithSlopes,
    /// The same; the lines move with sigma, and their slopes are blurred as well.
    BlurBoth,
}

/// A blur of lines of one length.
#[derive(Debug)]
pub(crate) struct Line<T> {
    /// Positions beyond either end: 1 for a zero border.
    pub(super) pad: usize,
    /// Positions, with the zeros.
    positions: usize,
    poles: Vec<Pole<T>>,
}

impl<T> Default for Line<T> {
    fn default() -> Self {
        Self { pad: 0, positions: 0, poles: Vec::new() }
    }
}

/// The system of one pole.
#[derive(Debug)]
struct Pole<T> {
    /// `-h / p_(i-1)` for pivots p: how elimination passes on; 0 at both ends.
    ratios: Vec<[T; 2]>,
    /// What they leave of 1, but 0 at the first position.
    rests: Vec<[T; 2]>,
    /// `c / p_i`.
    scales: Vec<[T; 2]>,
    /// What sigma's slope adds to the right side, in the line and at its ends.
    by_sigma: [T; 2],
    by_sigma_at_end: [T; 2],
}

impl<T: Scalar> Pole<T> {
    fn empty() -> Self {
        let zero = [T::ZERO; 2];
        let [ratios, rests, scales] = [const { Vec::new() }; 3];
        Self { ratios, rests, scales, by_sigma: zero, by_sigma_at_end: zero }
    }

    /// The system of the pole `z` with residue `g` over `n` positions.
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
        // Pivots are `-h (1 + d)`; as the line goes on, `1 + d` nears 1 / q: of the roots of
        // `q + 1/q - 2 = a` the one outside the unit circle.
        let middle = one + a * number(0.5);
        let root = (a * a + number(4.0) * a).sqrt() * number(0.5);
        let same_side = middle.re * root.re + middle.im * root.im >= T::Wide::ZERO;
        let limit = a * number(0.5) + if same_side { root } else { zero - root };
        let ratio = one / (one + limit);
        self.ratios.clear();
        self.rests.clear();
        self.scales.clear();
        self.ratios.push([T::ZERO; 2]);
        self.rests.push([T::ZERO; 2]);
        let scale = number(-2.0) * g;
        // `d / (1 + d)` of the position before.
        let mut before = if mirror { zero } else { limit * ratio };
        for _ in 1..n {
            let d = a + before;
            let ratio = one / (one + d);
            before = d * ratio;
            self.ratios.push(ratio.narrow());
            self.rests.push(before.narrow());
            self.scales.push((scale * ratio).narrow());
        }
        // Pivots at the last position: `-h d` for a mirror, else `-h (1 + d - ratio)`.
        let last = a + before + if mirror { zero } else { one - ratio };
        self.scales.push((scale / last).narrow());
        self.ratios.push([T::ZERO; 2]);
        let by_sigma = number(-1.0) * z / (g * h * Complex::real(sigma));
        self.by_sigma = by_sigma.narrow();
        let at_end = if mirror { one } else { one / (one - ratio * ratio) };
        self.by_sigma_at_end = (by_sigma * at_end).narrow();
    }
}

impl<T: Scalar> Line<T> {
    /// Fills in the blur by `order` with standard deviation `sigma`, in pixels, of lines of `extent`
    /// pixels.
    pub(crate) fn fill(&mut self, order: &Order, sigma: T, border: Border, extent: usize) {
        self.pad = usize::from(border == Border::Zero);
        self.positions = extent + 2 * self.pad;
        self.poles.resize_with(order.poles.len(), Pole::empty);
        for (pole, parts) in self.poles.iter_mut().zip(order.poles) {
            let [z, g] = parts.map(|[re, im]| {
                let number = T::Wide::from_f64;
                Complex { re: number(re), im: number(im) }
            });
            pole.fill(z, g, sigma.widen(), border == Border::Mirror, self.positions);
        }
    }

    /// Makes room for the lines' pixels, with zeros beyond their ends.
    #[inline(always)]
    pub(super) fn start(&self, block: &mut Block<T>, task: Task) {
        block.partial.resize(self.positions, [Lanes::ZERO; 2]);
        let moving = if task == Task::Blur { 1 } else { 2 };
        let pictures = [&mut block.lines, &mut block.slopes].into_iter().zip(&mut block.steps);
        for (lines, steps) in pictures.take(moving) {
            lines.resize(self.positions, Lanes::ZERO);
            steps.resize(self.positions, Lanes::ZERO);
            lines[..self.pad].fill(Lanes::ZERO);
            lines[self.positions - self.pad..].fill(Lanes::ZERO);
        }
    }

    /// Does `task` to the lines of `block`.
    #[inline(always)]
    pub(super) fn solve(&self, block: &mut Block<T>, task: Task) {
        let Block { lines, slopes, steps: [steps, steps_of_slopes], partial } = block;
        fill_steps(lines, steps);
        match task {
            Task::Blur => {}
            Task::BlurWithSlopes => {
                slopes.fill(Lanes::ZERO);
                steps_of_slopes.fill(Lanes::ZERO);
            }
            Task::BlurBoth => fill_steps(slopes, steps_of_slopes),
        }
        for pole in &self.poles {
            pole.eliminate(steps, partial);
            if task == Task::Blur {
                pole.substitute(partial, lines);
            } else {
                pole.substitute_and_eliminate(partial, lines, steps_of_slopes);
                pole.substitute_slopes(partial, slopes);
            }
        }
    }
}

/// Writes the steps from each position to the next; beyond the last there is none.
#[inline(always)]
fn fill_steps<T: Scalar>(lines: &[Lanes<T>], steps: &mut [Lanes<T>]) {
    for (pair, step) in lines.windows(2).zip(&mut *steps) {
        *step = difference(&pair[1], &pair[0]);
    }
    steps[lines.len() - 1] = Lanes::ZERO;
}

impl<T: Scalar> Pole<T> {
    /// `u_i = f_i + ratio_i u_(i-1)` with the bends `f_i = g_i - g_(i-1)` of steps g. Rounded bends
    /// would not add up to zero, and by as little the mean of a line would run away; so what is
    /// passed on is `u_i - g_i = ratio_i (u_(i-1) - g_(i-1)) - (1 - ratio_i) g_(i-1)`.
    #[inline(always)]
    fn eliminate(&self, steps: &[Lanes<T>], u: &mut [ComplexLanes<T>]) {
        u[0] = [steps[0], Lanes::ZERO];
        let mut state = [Lanes::ZERO; 2];
        let factors = self.ratios.iter().zip(&self.rests).skip(1);
        for (((&ratio, &[a, b]), pair), u) in factors.zip(steps.windows(2)).zip(&mut u[1..]) {
            let [re, im] = product(ratio, &state);
            state = [difference(&re, &scaled(a, &pair[0])), difference(&im, &scaled(b, &pair[0]))];
            *u = [sum_of(&state[0], &pair[1]), state[1]];
        }
    }

    /// `v_i = scale_i u_i + ratio_(i+1) v_(i+1)`, whose real part is added to `sums`.
    #[inline(always)]
    fn substitute(&self, u: &[ComplexLanes<T>], sums: &mut [Lanes<T>]) {
        let mut v = [Lanes::ZERO; 2];
        let factors = self.scales.iter().zip(&self.ratios[1..]);
        for (((&scale, &ratio), u), sum) in factors.zip(u).zip(sums).rev() {
            v = sum_of_products([scale, ratio], [u, &v]);
            *sum = sum_of(sum, &v[0]);
        }
    }

    /// The same, and on the way the elimination of the slopes' system, from the other end:
    /// `s_i = f_i + by_sigma v_i + ratio_(n-1-i) s_(i+1)`, which replaces u. What is passed on is
    /// `s_i + g_(i-1)`.
    #[inline(always)]
    fn substitute_and_eliminate(
        &self,
        u: &mut [ComplexLanes<T>],
        sums: &mut [Lanes<T>],
        steps: &[Lanes<T>],
    ) {
        let (mut v, mut state) = ([Lanes::ZERO; 2], [Lanes::ZERO; 2]);
        let n = sums.len();
        for i in (0..n).rev() {
            v = sum_of_products([self.scales[i], self.ratios[i + 1]], [&u[i], &v]);
            sums[i] = sum_of(&sums[i], &v[0]);
            let by_sigma = if i == 0 || i == n - 1 { self.by_sigma_at_end } else { self.by_sigma };
            let [re, im] = sum_of_products([by_sigma, self.ratios[n - 1 - i]], [&v, &state]);
            let [a, b] = self.rests[n - 1 - i];
            state = [sum_of(&re, &scaled(a, &steps[i])), sum_of(&im, &scaled(b, &steps[i]))];
            let before = if i == 0 { Lanes::ZERO } else { steps[i - 1] };
            u[i] = [difference(&state[0], &before), state[1]];
        }
    }

    /// `w_i = scale_(n-1-i) s_i + ratio_(n-i) w_(i-1)`, whose real part is added to `sums`.
    #[inline(always)]
    fn substitute_slopes(&self, s: &[ComplexLanes<T>], sums: &mut [Lanes<T>]) {
        let mut w = [Lanes::ZERO; 2];
        let factors = self.scales.iter().zip(&self.ratios[1..]).rev();
        for (((&scale, &ratio), s), sum) in factors.zip(s).zip(sums) {
            w = sum_of_products([scale, ratio], [s, &w]);
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

/// `factors[0] of[0] + factors[1] of[1]`.
#[inline(always)]
fn sum_of_products<T: Scalar>(
    [first, second]: [[T; 2]; 2],
    of: [&ComplexLanes<T>; 2],
) -> ComplexLanes<T> {
    let ([x_re, x_im], [y_re, y_im]) = (product(first, of[0]), product(second, of[1]));
    [sum_of(&x_re, &y_re), sum_of(&x_im, &y_im)]
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
