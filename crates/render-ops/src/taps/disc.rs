//! The weights of a disc: which share of it lies in each pixel.
//!
//! # Forward
//! In units of the radius R, with `x, y >= 0` cut to 1, the unit disc covers of `[0, x] x [0, y]`
//!
//! `Q = x y` where `x^2 + y^2 <= 1`, else `Q = (t(x) + t(y) + l) / 2`, with `t(x) = x sqrt(1 - x^2)`,
//!
//! where `l = asin x + asin y - pi / 2` is the length of its rim in there, and 0 in the first case. Both are
//! odd in x and in y. A pixel has the weight `w = D Q / pi`, with D the difference over its four corners.
//!
//! # Slope
//! `dw/dR = (D l - 2 pi w) / (pi R)`: the rim moves outwards, and the share of what it has passed falls.
//!
//! # Variance
//! Coverage adds a pixel's width to the disc, so R follows from the variance v that is wanted, per axis.
//! Beyond the line at x lies the share `(a - sin a cos a) / pi` of the disc, `cos a = x / R`. So the weights
//! have the variance
//!
//! `V(R) = (2 / pi) sum_j (2 j - 1) (a_j - sin a_j cos a_j)` with `x_j = j - 1/2 < R`, and
//! `dV/dR = (4 / (pi R)) sum_j (2 j - 1) sin a_j cos a_j`, which is above 0 for R > 1/2.
//!
//! R solves `V(R) = v`, and `dw/dv = (dw/dR) / (dV/dR)`. As long as the disc reaches no corner of its pixel,
//! `R <= 1 / sqrt 2`, four caps of the weight v / 2 lie in the four neighbours, and no R is needed.
//!
//! # Where it is not smooth
//! The slope has a kink where the rim touches a pixel's side, at R = 3/2, 5/2, ..; dw/dR is continuous there.
//!
//! # Precision
//! What rounding adds to the sum of the weights and to that of their slopes is taken out, as in a window of the
//! discrete Gaussian: they are 1 and 0 within 1e-15.

use std::f64::consts::{FRAC_1_PI, FRAC_1_SQRT_2, FRAC_PI_2, PI};

use bokashi_core::Scalar;

/// A step of the weights along a column: the pixels up to `reach` above and below the centre have this
/// much more than those beyond.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Step<T> {
    pub(crate) reach: usize,
    pub(crate) weight: T,
    /// The derivative of the weight with respect to sigma.
    pub(crate) slope: T,
}

/// A disc as steps along columns of pixels. The k-th column lies k pixels to the left and to the right of
/// the centre.
#[derive(Debug, Default)]
pub(crate) struct DiscTaps<T: Scalar> {
    steps: Vec<Step<T>>,
    /// Where the steps of each column begin, and where those of the last one end.
    starts: Vec<usize>,
    /// Memory: the steps in wide numbers, the weights at the rim of a column.
    wide: Vec<Step<T::Wide>>,
    rim: Vec<[T::Wide; 2]>,
}

/// The variance of a disc that reaches the corners of its pixel, `V(1 / sqrt 2)`.
const CAPS_ALONE: f64 = 0.5 - FRAC_1_PI;

impl<T: Scalar> DiscTaps<T> {
    /// Fills in the disc of this variance above 0, in pixels squared; sigma moves it by `by_sigma`.
    pub(crate) fn fill(&mut self, variance: T::Wide, by_sigma: T::Wide) {
        self.starts.clear();
        self.starts.push(0);
        self.wide.clear();
        if variance.to_f64() <= CAPS_ALONE {
            self.push_caps(variance, by_sigma);
        } else {
            self.push_pixels(variance, by_sigma);
            self.normalize();
        }
        let narrow = |&Step { reach, weight, slope }: &Step<T::Wide>| Step {
            reach,
            weight: T::narrow(weight),
            slope: T::narrow(slope),
        };
        self.steps.clear();
        self.steps.extend(self.wide.iter().map(narrow));
    }

    /// How many pixels the disc reaches to either side.
    pub(crate) fn reach(&self) -> usize {
        self.starts.len() - 2
    }

    /// The steps of the column `k` pixels beside the centre, from the inside out.
    pub(crate) fn column(&self, k: usize) -> &[Step<T>] {
        &self.steps[self.starts[k]..self.starts[k + 1]]
    }

    fn push_caps(&mut self, variance: T::Wide, by_sigma: T::Wide) {
        let number = T::Wide::from_f64;
        let (half, two) = (number(0.5), number(2.0));
        let cap = [half * variance, half * by_sigma];
        self.rim.clear();
        self.rim.extend([[T::Wide::ONE - two * variance, -(two * by_sigma)], cap]);
        self.push_column(0, [T::Wide::ZERO; 2]);
        self.rim.clear();
        self.rim.push(cap);
        self.push_column(0, [T::Wide::ZERO; 2]);
    }

    fn push_pixels(&mut self, variance: T::Wide, by_sigma: T::Wide) {
        let number = T::Wide::from_f64;
        let radius = matched_radius(variance);
        let [_, variance_slope] = variance_of(radius);
        let by_sigma = by_sigma / variance_slope;
        let whole = number(FRAC_1_PI) / (radius * radius);
        let whole = [whole, -(number(2.0) * whole / radius * by_sigma)];
        let value = radius.to_f64();
        let half_chord = |x: f64| if x < value { (value * value - x * x).sqrt() } else { 0.0 };
        for k in 0.. {
            // The column lies between `near` and `far`.
            let [near, far] = [k as f64 - 0.5, k as f64 + 0.5];
            if near >= value {
                break;
            }
            // Pixels below `inside` lie within the disc; those from `end` on see nothing of it.
            let chord = half_chord(far);
            let inside = if chord > 0.0 { (chord + 0.5).floor() as usize } else { 0 };
            let end = (half_chord(near.max(0.0)) + 0.5).ceil() as usize;
            self.rim.clear();
            let corners = |y: usize| {
                let y = y as f64 - 0.5;
                let [[q, l], [q_near, l_near]] = [far, near].map(|x| corner(x, y, radius));
                [q - q_near, l - l_near]
            };
            let mut below = corners(inside);
            for y in inside..end.max(inside) {
                let above = corners(y + 1);
                let [area, rim] = [above[0] - below[0], above[1] - below[1]];
                let slope = (rim - number(2.0) * area) / radius * by_sigma;
                self.rim.push([area, slope].map(|number_of| number(FRAC_1_PI) * number_of));
                below = above;
            }
            self.push_column(inside, whole);
        }
    }

    /// Adds a column: `inside` pixels from the centre on of the weight and slope `whole`, then those of
    /// the rim.
    fn push_column(&mut self, inside: usize, whole: [T::Wide; 2]) {
        let mut reach = inside.saturating_sub(1);
        let pixels = (inside > 0).then_some(whole).into_iter().chain(self.rim.iter().copied());
        let mut pixels = pixels.peekable();
        while let Some([weight, slope]) = pixels.next() {
            let [next, next_slope] = pixels.peek().copied().unwrap_or([T::Wide::ZERO; 2]);
            self.wide.push(Step { reach, weight: weight - next, slope: slope - next_slope });
            reach += 1;
        }
        self.starts.push(self.wide.len());
    }

    /// Takes out what rounding adds to the sum of the weights and to that of the slopes.
    fn normalize(&mut self) {
        let (mut total, mut total_slope) = (T::Wide::ZERO, T::Wide::ZERO);
        for (k, range) in self.starts.windows(2).enumerate() {
            let columns = if k == 0 { 1 } else { 2 };
            for step in &self.wide[range[0]..range[1]] {
                let count = T::Wide::from_f64((columns * (2 * step.reach + 1)) as f64);
                total += count * step.weight;
                total_slope += count * step.slope;
            }
        }
        for step in &mut self.wide {
            step.weight = step.weight / total;
            step.slope = (step.slope - step.weight * total_slope) / total;
        }
    }
}

/// `[Q, l]` at the corner `(x, y)`, in pixels from the centre of a disc.
fn corner<S: Scalar>(x: f64, y: f64, radius: S) -> [S; 2] {
    let sign = S::from_f64(x.signum() * y.signum());
    let [x, y] = [x.abs(), y.abs()];
    let [u, v] = [x, y].map(|at| S::from_f64(at) / radius);
    if x.hypot(y) <= radius.to_f64() {
        return [sign * u * v, S::ZERO];
    }
    // The angle and t, each with the same square root; at 1 it has no derivative, and needs none.
    let arc = |u: S| match u < S::ONE {
        true => {
            let root = ((S::ONE - u) * (S::ONE + u)).sqrt();
            [u.atan2(root), u * root]
        }
        false => [S::from_f64(FRAC_PI_2), S::ZERO],
    };
    let [[s_u, t_u], [s_v, t_v]] = [arc(u), arc(v)];
    let l = s_u + s_v - S::from_f64(FRAC_PI_2);
    [sign * S::from_f64(0.5) * (t_u + t_v + l), sign * l]
}

/// `[V, dV/dR]`.
fn variance_of<S: Scalar>(radius: S) -> [S; 2] {
    let value = radius.to_f64();
    let (mut sum, mut slope) = (S::ZERO, S::ZERO);
    for j in 1.. {
        let x = j as f64 - 0.5;
        if x >= value {
            break;
        }
        let cosine = S::from_f64(x) / radius;
        let sine = ((S::ONE - cosine) * (S::ONE + cosine)).sqrt();
        let count = S::from_f64((2 * j - 1) as f64);
        sum += count * (sine.atan2(cosine) - sine * cosine);
        slope += count * sine * cosine;
    }
    [S::from_f64(2.0 / PI) * sum, S::from_f64(4.0 / PI) * slope / radius]
}

/// The radius R at which the weights have this variance, which is above [`CAPS_ALONE`].
fn matched_radius<S: Scalar>(variance: S) -> S {
    let wanted = variance.to_f64();
    // Newton's steps, and halves where one leaves the interval. Coverage adds to the disc's own variance,
    // so R is below the radius of a disc that is not cut into pixels.
    let (mut low, mut high) = (FRAC_1_SQRT_2, 2.0 * wanted.sqrt() + 1.0);
    let mut radius = 2.0 * (wanted - 1.0 / 12.0).sqrt();
    for _ in 0..100 {
        let [found, slope] = variance_of(radius);
        if found > wanted {
            high = radius;
        } else {
            low = radius;
        }
        let newton = radius - (found - wanted) / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - radius).abs() <= 2.0 * f64::EPSILON * radius {
            break;
        }
        radius = next;
    }
    // Each more step gives R one more derivative, where the variance has any.
    (0..3).fold(S::from_f64(radius), |radius, _| {
        let [found, slope] = variance_of(radius);
        radius - (found - variance) / slope
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The weights and slopes of the pixels of a quadrant, centre included.
    fn pixels(taps: &DiscTaps<f64>) -> Vec<Vec<[f64; 2]>> {
        let size = taps.reach() + 1;
        let pixel = |k: usize, y: usize| {
            let steps = taps.column(k).iter().filter(|step| step.reach >= y);
            steps.fold([0.0, 0.0], |[w, s], step| [w + step.weight, s + step.slope])
        };
        (0..size).map(|k| (0..size).map(|y| pixel(k, y)).collect()).collect()
    }

    fn disc(sigma: f64) -> Vec<Vec<[f64; 2]>> {
        let mut taps = DiscTaps::<f64>::default();
        taps.fill(sigma * sigma, 2.0 * sigma);
        pixels(&taps)
    }

    /// `sum_ij f(i, j) w_ij` of weights and slopes, over all four quadrants.
    fn sums(disc: &[Vec<[f64; 2]>], f: impl Fn(f64, f64) -> f64) -> [f64; 2] {
        let size = disc.len() as isize - 1;
        // What additions round off is added in the end: many weights are the same, and round the same way.
        let (mut sums, mut lost) = ([0.0_f64; 2], [0.0_f64; 2]);
        for (i, j) in (-size..=size).flat_map(|i| (-size..=size).map(move |j| (i, j))) {
            let pixel = disc[i.unsigned_abs()][j.unsigned_abs()];
            for n in 0..2 {
                let term = f(i as f64, j as f64) * pixel[n];
                let sum = sums[n] + term;
                let [large, small] =
                    if sums[n].abs() > term.abs() { [sums[n], term] } else { [term, sums[n]] };
                lost[n] += (large - sum) + small;
                sums[n] = sum;
            }
        }
        [sums[0] + lost[0], sums[1] + lost[1]]
    }

    const SIGMAS: [f64; 14] =
        [1e-9, 1e-3, 0.2, 0.426, 0.4263, 0.5, 0.8, 1.0, 1.3, 2.0, 3.3, 7.9, 31.0, 200.0];

    #[test]
    fn weights_sum_to_1_and_have_the_variance_of_sigma() {
        for sigma in SIGMAS {
            let disc = disc(sigma);
            let [sum, slope] = sums(&disc, |_, _| 1.0);
            // 1e-15, and a little more for the widest, of some thousand steps.
            let bound = if sigma < 100.0 { 1e-15 } else { 4e-15 };
            assert!((sum - 1.0).abs() <= bound && slope.abs() <= bound, "{sigma}: {sum}, {slope}");
            for axis in 0..2 {
                let [variance, slope] = sums(&disc, |i, j| if axis == 0 { i * i } else { j * j });
                approx::assert_relative_eq!(variance, sigma * sigma, max_relative = 1e-11);
                approx::assert_relative_eq!(slope, 2.0 * sigma, max_relative = 1e-9);
            }
        }
    }

    #[test]
    fn radii_are_those_of_known_discs() {
        // Radius of the disc in the plane, and of the one that is cut into pixels.
        for (radius, matched) in [(1.0, 0.788), (3.0, 2.932), (8.0, 7.976)] {
            let found: f64 = matched_radius(0.25 * radius * radius);
            assert!((found - matched).abs() < 6e-4, "{radius}: {found}");
        }
    }

    #[test]
    fn no_weight_is_negative_and_weights_are_the_same_in_rows_and_columns() {
        for sigma in SIGMAS {
            let disc = disc(sigma);
            let largest = disc[0][0][0];
            for (i, j) in (0..disc.len()).flat_map(|i| (0..disc.len()).map(move |j| (i, j))) {
                let [weight, slope] = disc[i][j];
                assert!(weight >= -1e-15, "{sigma}: {weight}");
                assert!((weight - disc[j][i][0]).abs() <= 1e-13 * largest, "{sigma}");
                assert!((slope - disc[j][i][1]).abs() <= 1e-12 * largest, "{sigma}");
            }
        }
    }

    #[test]
    fn weights_are_areas_of_pixels_under_the_disc() {
        let sigma = 1.7;
        let radius: f64 = matched_radius(sigma * sigma);
        let disc = disc(sigma);
        const SAMPLES: usize = 2000;
        let area = PI * radius * radius;
        for (i, j) in (0..disc.len()).flat_map(|i| (0..disc.len()).map(move |j| (i, j))) {
            // Of each of many thin columns of the pixel, the length within the disc.
            let length = |k: usize| {
                let x = i as f64 - 0.5 + (k as f64 + 0.5) / SAMPLES as f64;
                let chord = (radius * radius - x * x).max(0.0).sqrt();
                let [low, high] = [j as f64 - 0.5, j as f64 + 0.5];
                (chord.min(high) - low.max(-chord)).max(0.0)
            };
            let share = (0..SAMPLES).map(length).sum::<f64>() / SAMPLES as f64 / area;
            assert!((disc[i][j][0] - share).abs() < 1e-6, "{i} {j}: {:?} {share}", disc[i][j]);
        }
    }

    #[test]
    fn slopes_are_difference_quotients() {
        for sigma in [1e-3, 0.2, 0.5, 0.8, 1.0, 1.3, 2.0, 3.3, 7.9] {
            let h = 2e-6;
            let [nominal, above, below] = [sigma, sigma + h, sigma - h].map(disc);
            let weight = |disc: &[Vec<[f64; 2]>], i: usize, j: usize| {
                disc.get(i).and_then(|row| row.get(j)).map_or(0.0, |pixel| pixel[0])
            };
            for (i, j) in (0..nominal.len()).flat_map(|i| (0..nominal.len()).map(move |j| (i, j))) {
                let quotient = (weight(&above, i, j) - weight(&below, i, j)) / (2.0 * h);
                let slope = nominal[i][j][1];
                assert!((slope - quotient).abs() < 1e-9, "{sigma} {i} {j}: {slope} {quotient}");
            }
        }
    }
}
