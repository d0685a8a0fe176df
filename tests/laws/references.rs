//! What the catalogue's extreme cases are compared with, worked out by hand.

use bokashi_catalogue::oracle::GridScene;
use bokashi_catalogue::{Verdict, visible_areas};
use bokashi_render_ops::Size;

#[test]
fn areas_worked_out_by_hand() {
    // In an image of 2 x 2 pixels: half of it, the lower triangle, and before it the left half.
    let clip = [
        [-1.0, -1.0, 0.5, 1.0],
        [1.0, -1.0, 0.5, 1.0],
        [-1.0, 1.0, 0.5, 1.0],
        [0.0, -9.0, 0.0, 1.0],
        [0.0, 9.0, 0.0, 1.0],
        [-40.0, 0.0, 0.0, 1.0],
    ];
    let areas = |faces: &[[u32; 3]]| {
        let pixels = [[0, 0], [1, 0], [0, 1], [1, 1]];
        pixels.map(|pixel| visible_areas(&clip, faces, Size::square(2), pixel))
    };
    let close = |found: [Vec<f64>; 4], expected: [&[f64]; 4]| {
        for (found, expected) in found.iter().flatten().zip(expected.into_iter().flatten()) {
            assert!((found - expected).abs() < 1e-14, "{found} instead of {expected}");
        }
    };
    close(areas(&[[0, 1, 2]]), [&[0.5], &[0.0], &[1.0], &[0.5]]);
    close(areas(&[[0, 1, 2], [3, 4, 5]]), [&[0.0, 1.0], &[0.0; 2], &[0.0, 1.0], &[0.5, 0.0]]);
    close(areas(&[[0, 1, 2], [2, 1, 0]]), [&[0.5, 0.0], &[0.0; 2], &[1.0, 0.0], &[0.5, 0.0]]);
    close(areas(&[[0, 1, 1]]), [&[0.0]; 4]);
}

#[test]
fn faces_pass_through_each_other_where_their_depths_are_equal() {
    // Depths of slopes 1/2 and -1/2, equal at x = 1/2: three quarters of the one pixel's width.
    let corner = |x: f64, y: f64, slope: f64| [x, y, slope * (x - 0.5), 1.0];
    let of = |slope| [[-1.0, -1.0], [3.0, -1.0], [-1.0, 3.0]].map(|[x, y]| corner(x, y, slope));
    let clip = [of(0.5), of(-0.5)].concat();
    let areas = visible_areas(&clip, &[[0, 1, 2], [3, 4, 5]], Size::square(1), [0, 0]);
    assert!((areas[0] - 0.75).abs() < 1e-14 && (areas[1] - 0.25).abs() < 1e-14, "{areas:?}");
}

#[test]
fn only_an_error_within_the_bound_passes() {
    assert!(Verdict::within("", 1.0, 1.0).pass);
    for (error, bound) in [(1.1, 1.0), (f64::NAN, 1.0), (f64::INFINITY, 1.0), (1.0, f64::NAN)] {
        assert!(!Verdict::within("", error, bound).pass);
    }
    assert_eq!(Verdict::exactly("none", 3).outcome, "off by 3.0e0 from: none");
    let verdict = Verdict::exactly("right", 0).and(false, "late");
    assert_eq!((verdict.pass, &*verdict.outcome), (false, "right; but late"));
}

#[test]
fn only_the_expected_message_is_a_refusal() {
    let refused = |result| Verdict::refused(vec![(result, "no".to_owned())]);
    assert!(refused(Err("no".to_owned())).pass);
    assert!(!refused(Err("yes".to_owned())).pass && !refused(Ok(())).pass);
}

#[test]
fn a_square_cut_in_two_covers_its_pixels_once_in_whole_numbers() {
    // From the centre of pixel (1, 1) to that of pixel (3, 3): top and left belong to it.
    let [low, high] = [96, 224];
    let points = vec![[low, low], [high, low], [high, high], [low, high]];
    let scene = GridScene { points, faces: vec![[0, 1, 2], [0, 3, 2]], size: Size::square(4) };
    let expected = [0, 0, 0, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0];
    assert_eq!(scene.layers(), expected);
}
