use crate::fixtures::number;
use approx::assert_relative_eq;
use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{Border, Filter, downsample};

const BORDERS: [Border; 3] = [Border::Zero, Border::Mirror, Border::Clamp];

fn filters() -> Vec<Filter> {
    let skewed = |x: f64| 1.0 + 0.4 * x + 2.0 * (-x * x).exp();
    vec![
        Filter::Box,
        Filter::Triangle,
        Filter::Mitchell,
        Filter::Lanczos(3),
        Filter::custom(1.63, skewed),
        // Some of a block, on one side of it.
        Filter::custom(0.43, |x| if x > -0.03 { 0.2 + x } else { 0.0 }),
    ]
}

/// The function of a filter, from its definition.
fn weight(filter: usize, x: f64) -> f64 {
    let sinc = |x: f64| {
        if x == 0.0 { 1.0 } else { (std::f64::consts::PI * x).sin() / (std::f64::consts::PI * x) }
    };
    let a = x.abs();
    match filter {
        0 => f64::from(u8::from(a < 0.5)),
        1 => (1.0 - a).max(0.0),
        2 if a < 1.0 => 7.0 / 6.0 * a.powi(3) - 2.0 * a * a + 8.0 / 9.0,
        2 if a < 2.0 => -7.0 / 18.0 * a.powi(3) + 2.0 * a * a - 10.0 / 3.0 * a + 16.0 / 9.0,
        3 if a < 3.0 => sinc(x) * sinc(x / 3.0),
        4 if a < 1.63 => 1.0 + 0.4 * x + 2.0 * (-x * x).exp(),
        5 if a < 0.43 && x > -0.03 => 0.2 + x,
        _ => 0.0,
    }
}

/// The matrix of a line, `[n / k][n]`, tap by tap.
fn matrix(filter: usize, k: usize, border: Border, n: usize) -> Vec<Vec<f64>> {
    let reach = 4 * k as isize;
    let x = |j: usize, i: isize| (i as f64 + 0.5) / k as f64 - j as f64 - 0.5;
    let total: f64 = (-reach..reach).map(|i| weight(filter, x(0, i))).sum();
    let row = |j: usize| {
        let mut row = vec![0.0; n];
        let start = (j * k) as isize;
        for i in start - reach..start + reach {
            let source = match border {
                Border::Zero => (0..n as isize).contains(&i).then_some(i),
                Border::Clamp => Some(i.clamp(0, n as isize - 1)),
                Border::Mirror => {
                    let phase = i.rem_euclid(2 * n as isize);
                    Some(phase.min(2 * n as isize - 1 - phase))
                }
            };
            if let Some(source) = source {
                row[source as usize] += weight(filter, x(j, i)) / total;
            }
        }
        row
    };
    (0..n / k).map(row).collect()
}

/// The result and the gradient for motley upstream.
fn run<T: Scalar>(
    shape: [usize; 3],
    image: impl Fn(usize) -> f64,
    k: usize,
    filter: &Filter,
    border: Border,
) -> [Vec<f64>; 2] {
    let tape = Tape::<T>::new();
    let image = tape.leaf(&Tensor::from_flat_fn(shape, |at| T::from_f64(image(at))));
    let out = downsample(image, k, filter, border).unwrap();
    assert_eq!(out.shape(), [shape[0] / k, shape[1] / k, shape[2]].into());
    let upstream = Tensor::from_flat_fn(out.shape(), |at| T::from_f64(number(5 * at + 1)));
    let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
    let entries = |tensor: &Tensor<T>| tensor.data().iter().map(|x| x.to_f64()).collect();
    [entries(&out.value()), entries(&gradients.get_or_zeros(image))]
}

#[test]
fn each_pixel_is_the_double_sum_over_its_window_and_the_gradient_the_transpose() {
    for (which, filter) in filters().iter().enumerate() {
        for border in BORDERS {
            // Windows smaller and larger than the image, rows and columns alone, one pixel.
            for (k, [height, width, channels]) in [
                (1, [3, 5, 2]),
                (2, [6, 4, 1]),
                (3, [3, 15, 3]),
                (4, [8, 4, 4]),
                (5, [5, 25, 5]),
                (1, [1, 1, 1]),
                (1, [1, 40, 1]),
                (2, [2, 2, 1]),
                (2, [70, 34, 3]),
            ] {
                let by_rows = matrix(which, k, border, height);
                let by_columns = matrix(which, k, border, width);
                let [found, bars] =
                    run::<f64>([height, width, channels], number, k, filter, border);
                let (mut expected, mut expected_bars) = (Vec::new(), vec![0.0; bars.len()]);
                for row in &by_rows {
                    for column in &by_columns {
                        for c in 0..channels {
                            let bar = number(5 * expected.len() + 1);
                            let mut sum = 0.0;
                            for (i, wy) in row.iter().enumerate() {
                                for (j, wx) in column.iter().enumerate() {
                                    let at = (i * width + j) * channels + c;
                                    sum += wy * wx * number(at);
                                    expected_bars[at] += wy * wx * bar;
                                }
                            }
                            expected.push(sum);
                        }
                    }
                }
                let what = format!("{filter:?}, {border:?}, {k}, {height} x {width}");
                for (found, expected) in
                    found.iter().zip(&expected).chain(bars.iter().zip(&expected_bars))
                {
                    assert!((found - expected).abs() < 1e-14, "{what}: {found} {expected}");
                }
            }
        }
    }
}

#[test]
fn constants_are_kept_by_every_filter_but_under_a_zero_border_that_it_sees() {
    for filter in filters() {
        for border in [Border::Mirror, Border::Clamp] {
            for k in [1, 2, 3, 8] {
                let [found, bars] = run::<f64>([48, 24, 3], |_| 0.7, k, &filter, border);
                assert!(found.iter().all(|entry| (entry - 0.7).abs() < 1e-15), "{filter:?}");
                // The sum of all weights is the number of pixels.
                let upstream: f64 = (0..found.len()).map(|at| number(5 * at + 1)).sum();
                assert_relative_eq!(bars.iter().sum::<f64>(), upstream, epsilon = 1e-12);
            }
        }
    }
    let [found, _] = run::<f64>([8, 8, 1], |_| 0.7, 4, &Filter::Box, Border::Zero);
    assert_eq!(found, [0.7; 4]);
    let [found, _] = run::<f64>([8, 8, 1], |_| 0.7, 4, &Filter::Triangle, Border::Zero);
    assert!(found.iter().all(|&entry| entry < 0.69));
}

#[test]
fn a_ramp_stays_a_ramp_away_from_the_border() {
    // Output pixels have their centres in the middle of their blocks: at k (j + 1/2), from 0 on.
    for filter in [Filter::Box, Filter::Triangle, Filter::Mitchell, Filter::Lanczos(3)] {
        for k in [1, 2, 3, 5] {
            let shape = [k, 12 * k, 1];
            let ramp = |at: usize| (at % (12 * k)) as f64 + 0.5;
            let [found, _] = run::<f64>(shape, ramp, k, &filter, Border::Mirror);
            for j in 3..9 {
                assert_relative_eq!(found[j], k as f64 * (j as f64 + 0.5), epsilon = 1e-12);
            }
        }
    }
}

#[test]
fn two_boxes_in_a_row_are_one() {
    let tape = Tape::<f64>::new();
    let image = tape.leaf(&Tensor::from_flat_fn([12, 24, 3], number));
    let by = |image, k| downsample(image, k, &Filter::Box, Border::Mirror).unwrap();
    let (twice, once) = (by(by(image, 2), 3).value(), by(image, 6).value());
    for (twice, once) in twice.data().iter().zip(once.data()) {
        assert_relative_eq!(twice, once, epsilon = 1e-15);
    }
}

#[test]
fn a_factor_of_1_is_the_identity_where_the_filter_interpolates() {
    let tape = Tape::<f64>::new();
    let image = tape.leaf(&Tensor::from_flat_fn([3, 5, 2], number));
    let parabola = Filter::custom(1.7, |x| (1.0 - x * x).max(0.0));
    for filter in [Filter::Box, Filter::Triangle, Filter::Lanczos(2), Filter::Lanczos(5), parabola]
    {
        for border in BORDERS {
            let before = tape.len();
            let out = downsample(image, 1, &filter, border).unwrap();
            assert_eq!((out.value(), tape.len()), (image.value(), before), "{filter:?}");
        }
    }
    let report = tape.take_report();
    let why = "the factor is 1, and the filter interpolates";
    assert!(
        report
            .left_out
            .iter()
            .any(|of| of.name == "downsample" && of.reason == why && of.count == 15)
    );
    let blurred = downsample(image, 1, &Filter::Mitchell, Border::Mirror).unwrap();
    assert_ne!(blurred.value(), image.value());
    // One pixel on, which is no identity.
    let shifted = Filter::custom(1.7, |x| f64::from(u8::from(x == 1.0)));
    let shifted = downsample(image, 1, &shifted, Border::Zero).unwrap().value();
    assert_eq!(shifted[[0, 0, 0]], image.value()[[1, 1, 0]]);
}

#[test]
fn long_sums_of_f32_keep_their_digits() {
    // A million positive numbers, and rows of a thousand.
    let entry = |at: usize| f64::from((number(at) + 0.7) as f32);
    for (shape, k) in [([1024, 1024, 1], 1024), ([2048, 4096, 1], 2048)] {
        let [found, _] = run::<f32>(shape, entry, k, &Filter::Box, Border::Mirror);
        for (j, found) in found.into_iter().enumerate() {
            let pixels = (0..k).flat_map(|i| (0..k).map(move |l| i * shape[1] + j * k + l));
            let expected = pixels.map(entry).sum::<f64>() / (k * k) as f64;
            assert!((found / expected - 1.0).abs() < 2e-6, "{found} {expected}");
        }
    }
}
