use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::camera::{distortion_radius, undistorted};
use bokashi_render_ops::distort;
use glam::DVec2;

/// The first turns round at about 1.5, the second never does up to 16, and the denominator of the third falls
/// to 0 at 2.
const LENSES: [[f64; 8]; 3] = [
    [-0.28, 0.07, 0.003, -0.002, -0.01, 0.12, -0.03, 0.004],
    [0.5, 0.2, -0.01, 0.02, 0.01, 0.8, 0.35, 0.02],
    [0.1, 0.0, 0.001, 0.002, 0.0, -0.25, 0.0, 0.0],
];
const POINTS: [[f64; 3]; 5] =
    [[0.3, -0.4, 2.0], [1.1, 0.9, 1.6], [0.0, 0.0, 3.0], [-1.0, 0.5, 1.0], [0.2, 1.9, 2.0]];

fn distorted(lens: &[f64], points: &[[f64; 3]]) -> Tensor<f64> {
    let tape = Tape::new();
    let points = tape.constant(&Tensor::from(points.to_vec()));
    distort(points, tape.constant(&Tensor::from(lens))).unwrap().value()
}

#[test]
fn eight_coefficients_are_those_of_opencv() {
    // cv2.projectPoints of POINTS with the first two lenses, OpenCV 5.0.0: the identity for the camera matrix,
    // rotation and translation 0.
    let expected = [
        [
            [0.1459401415960859, -0.19456602212811452],
            [0.5203775178308085, 0.4294218043615706],
            [0.0, 0.0],
            [-0.6754634317862165, 0.34023171589310824],
            [0.07182173002778289, 0.7023814352639374],
        ],
        [
            [0.14999097974651796, -0.19894630632869062],
            [0.5905530183211757, 0.4623771854445982],
            [0.0, 0.0],
            [-0.681797583081571, 0.34089879154078545],
            [0.09680296540499733, 0.7371281713474747],
        ],
    ];
    for (lens, expected) in LENSES.iter().zip(expected) {
        let found = distorted(lens, &POINTS);
        for (k, ([x, y], [_, _, z])) in expected.into_iter().zip(POINTS).enumerate() {
            let own = [0, 1, 2].map(|j| found[[k, j]]);
            for (own, expected) in own.into_iter().zip([x * z, y * z, z]) {
                assert!((own - expected).abs() < 1e-14, "{own} and not {expected}");
            }
        }
    }
}

#[test]
fn five_coefficients_are_the_first_of_eight() {
    let [five, rest] = [[-0.35, 0.03, 0.003, -0.002, -0.002], [0.0; 5]];
    let eight = [&five[..], &rest[..3]].concat();
    let points = [&POINTS[..], &[[3.0, 1.0, 0.5], [1.0, -2.0, -1.0]]].concat();
    assert_eq!(distorted(&five, &points), distorted(&eight, &points));
}

#[test]
fn the_rim_is_before_a_pole() {
    let expected = 2.0 * (1.0_f64 - 0.05).sqrt();
    assert!((distortion_radius(LENSES[2]) / expected - 1.0).abs() < 1e-14);
    let found = distorted(&LENSES[2], &[[1.9, 0.5, 1.0], [2.5, 0.0, 1.0], [0.5, 0.5, -1.0]]);
    assert!(found.is_finite());
    assert_eq!(distortion_radius(LENSES[1]), 16.0);
    // The radial part of the first is largest there.
    let limit = distortion_radius(LENSES[0]);
    let [k1, k2, _, _, k3, k4, k5, k6] = LENSES[0];
    let radius = |r: f64| {
        let s = r * r;
        let upper = 1.0 + s * (k1 + s * (k2 + s * k3));
        r * upper / (1.0 + s * (k4 + s * (k5 + s * k6)))
    };
    let most = (1..16000).map(|k| 1e-3 * k as f64).find(|&r| radius(r + 1e-3) < radius(r));
    assert!((most.unwrap() - limit).abs() < 2e-3, "{limit} and not {most:?}");
}

#[test]
fn undistorting_a_distorted_point_gives_the_point_back() {
    for lens in LENSES {
        for k in 0..50 {
            let reach = distortion_radius(lens).min(1.6);
            let point = 0.018 * reach * k as f64 * DVec2::from_angle(0.1 * k as f64);
            let shown = distorted(&lens, &[[point.x, point.y, 1.0]]);
            let shown = DVec2::new(shown.data()[0], shown.data()[1]);
            let found = undistorted(shown, lens).expect("the lens shows it");
            assert!(found.abs_diff_eq(point, 1e-9), "{found} and not {point}");
        }
    }
}
