use approx::assert_relative_eq;
use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{exposure, srgb_decode, srgb_encode};

const NUMBERS: [f64; 12] =
    [0.0, -0.0, 1e-300, 0.001, 0.0031308, 0.0031309, 0.2, 0.5, 1.0, 3.0, -0.4, -1e-4];

#[test]
fn known_numbers() {
    let tape = Tape::<f64>::new();
    let light = tape.leaf(&Tensor::from([0.0, 1.0, 0.18, 0.001, 0.21404114048223255]));
    let found = srgb_encode(light).unwrap().value();
    // 18 % grey, and half of what a file holds.
    for (found, expected) in found.data().iter().zip([0.0, 1.0, 0.461356129, 0.01292, 0.5]) {
        assert_relative_eq!(*found, expected, epsilon = 1e-9);
    }
}

#[test]
fn the_line_ends_where_the_standard_says() {
    let tape = Tape::<f64>::new();
    let decoded = srgb_decode(tape.leaf(&Tensor::from([0.0395, 0.0404, 0.0405]))).unwrap();
    let power = |y: f64| ((y + 0.055) / 1.055_f64).powf(2.4);
    assert_eq!(decoded.value(), Tensor::from([0.0395 / 12.92, 0.0404 / 12.92, power(0.0405)]));
    // 12.92 x 0.0031308 is 0.04045; with 0.03928 the line would end at 0.00304.
    let encoded = srgb_encode(tape.leaf(&Tensor::from([0.00305, 0.0031307]))).unwrap();
    assert_eq!(encoded.value(), Tensor::from([12.92 * 0.00305, 12.92 * 0.0031307]));
}

#[test]
fn decoding_is_the_inverse_of_encoding_and_both_are_odd() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&Tensor::from(NUMBERS));
    let there = srgb_encode(x).unwrap();
    let back = srgb_decode(there).unwrap().value();
    for (found, expected) in back.data().iter().zip(NUMBERS) {
        // At the seam the two differ by the rounding of their constants.
        assert_relative_eq!(*found, expected, max_relative = 1e-6);
        if expected.abs() > 0.004 || expected.abs() < 0.003 {
            assert_relative_eq!(*found, expected, max_relative = 1e-14);
        }
    }
    let opposite = srgb_encode(-x).unwrap().value();
    assert_eq!(opposite, (-there).value());
}

#[test]
fn the_slope_at_the_seam_is_that_of_the_line() {
    let tape = Tape::<f64>::new();
    let light = tape.leaf(&Tensor::from([0.0031308, 0.0031308 + 1e-15, 0.0031308 + 1e-12]));
    let encoded = srgb_encode(light).unwrap();
    let slopes = encoded.sum().backward().unwrap().get_or_zeros(light);
    assert_eq!(slopes[[0]], 12.92);
    assert_relative_eq!(slopes[[2]], 12.70, max_relative = 2e-3);
    let jump = encoded.value()[[1]] - encoded.value()[[0]];
    assert!(jump.abs() < 3e-8, "{jump}");
}

#[test]
fn a_stop_doubles_the_light() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&Tensor::from([1.0, -0.5, 3.0]));
    let stops = tape.leaf_scalar(2.0);
    let out = exposure(x, stops).unwrap();
    for (found, expected) in out.value().data().iter().zip([4.0, -2.0, 12.0]) {
        assert_relative_eq!(*found, expected, max_relative = 1e-15);
    }
    let gradients = out.sum().backward().unwrap();
    let expected = 14.0 * std::f64::consts::LN_2;
    assert_relative_eq!(gradients.get_or_zeros(stops).item(), expected, max_relative = 1e-14);
}

#[test]
fn what_is_not_finite_stays_so() {
    let tape = Tape::<f64>::new();
    let light = tape.leaf(&Tensor::from([f64::NAN, f64::NEG_INFINITY]));
    for out in [srgb_encode(light), srgb_decode(light)] {
        let out = out.unwrap().value();
        assert!(out[[0]].is_nan());
        assert_eq!(out[[1]], f64::NEG_INFINITY);
    }
}
