use bokashi_core::{Dual, Scalar};

fn assert_near(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance * a.abs().max(1.0), "{a} {b}");
}

/// The derivative of `f` at `x`, forward and by differences.
fn both(x: f64, f: impl Fn(Dual<f64>) -> Dual<f64>) -> (f64, f64) {
    let at = |x: f64| f(Dual::new(x, 0.0)).value;
    let central = |h: f64| (at(x + h) - at(x - h)) / (2.0 * h);
    let quotient = (4.0 * central(5e-4) - central(1e-3)) / 3.0;
    (f(Dual::new(x, 1.0)).tangent, quotient)
}

#[test]
fn every_function_carries_its_derivative() {
    let functions: [fn(Dual<f64>) -> Dual<f64>; 22] = [
        |x| x + x,
        |x| Dual::ONE - x,
        |x| x * x * x,
        |x| Dual::ONE / x,
        |x| x / (x * x + Dual::ONE),
        |x| -x,
        Dual::exp,
        |x| (x * x).ln(),
        |x| (x * x).ln_1p(),
        |x| (x * x).sqrt(),
        Dual::sin,
        Dual::cos,
        |x| (x * x).atan2(Dual::ONE - x),
        Dual::tanh,
        |x| x.powi(5),
        |x| x.powi(-2),
        |x| x.powi(0),
        |x| x.powf(Dual::from_f64(3.0)),
        |x| (x * x).powf(x),
        |x| Dual::from_f64(0.0).powf(x * x),
        Dual::abs,
        |x| [x, x * x, x].into_iter().sum(),
    ];
    for function in functions {
        for x in [-1.7, -0.3, 0.4, 2.1] {
            let (forward, quotient) = both(x, function);
            assert_near(forward, quotient, 1e-9);
        }
    }
    let mut x = Dual::new(2.0, 0.0);
    x += Dual::new(1.0, 1.0);
    x -= Dual::new(0.0, 3.0);
    x *= Dual::new(1.0, 1.0);
    assert_eq!((x.value, x.tangent), (3.0, 1.0));
}

#[test]
fn comparisons_go_by_value() {
    let (less, more) = (Dual::new(1.0, 9.0), Dual::new(2.0, -9.0));
    assert!(less < more && less == Dual::new(1.0, 0.0));
    assert_eq!(less.minimum_or_nan(more).tangent, 9.0);
    assert_eq!(less.maximum_or_nan(more).tangent, -9.0);
    assert!(Dual::new(f64::NAN, 0.0).minimum_or_nan(more).value.is_nan());
    assert!(Dual::new(1.0, f64::NAN).is_finite());
}

#[test]
fn a_dual_of_duals_carries_second_derivatives() {
    let x = Dual::new(Dual::new(0.7_f64, 1.0), Dual::new(1.0, 0.0));
    let y = x.sin();
    assert_near(y.tangent.tangent, -(0.7_f64.sin()), 1e-15);
    assert_eq!(y.to_f64(), 0.7_f64.sin());
}

#[test]
fn a_number_that_stays_adds_nothing_to_the_derivative_of_a_power() {
    let still = |x: f64| Dual::new(x, 0.0);
    // The logarithm of -2 is none, and the root has no slope at 0.
    assert_eq!(Dual::new(-2.0, 1.0).powf(still(3.0)).tangent, 12.0);
    assert_eq!(still(0.0).powf(Dual::new(0.5, 1.0)).tangent, 0.0);
    assert_eq!(Dual::new(0.0_f64, 1.0).powf(still(0.5)).tangent, f64::INFINITY);
    assert!(still(-2.0).powf(Dual::new(3.0, 1.0)).tangent.is_nan());
    let second = Dual::new(Dual::new(0.0, 1.0), Dual::new(1.0, 0.0));
    let square = second.powf(Dual::from_f64(2.0));
    assert_eq!((square.tangent.value, square.tangent.tangent), (0.0, 2.0));
}

#[test]
fn single_precision_widens_with_its_tangent() {
    let wide = Dual::new(0.1_f32, 0.3).widen();
    assert_eq!((wide.value, wide.tangent), (f64::from(0.1_f32), f64::from(0.3_f32)));
    let narrow: Dual<f32> = Dual::narrow(wide);
    assert_eq!((narrow.value, narrow.tangent), (0.1, 0.3));
    assert_eq!(<Dual<f32>>::from_f64(0.5).to_string(), "0.5 + 0 e");
}
