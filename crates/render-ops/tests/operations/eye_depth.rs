use crate::fixtures::surface;
use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::camera::perspective;
use bokashi_render_ops::{
    Fragments, Mesh, RasterOptions, RenderError, Sampling, Size, eye_depth, eye_depth_slope,
    project, rasterize,
};
use glam::{DMat4, DVec3};

const SIZE: Size = Size { width: 9, height: 7 };

/// A face in perspective, between 1.5 and 4 units before the eye, and its corners.
const CORNERS: [[f64; 3]; 3] = [[-0.9, -0.6, -1.5], [1.4, -0.9, -2.5], [-0.2, 1.9, -4.0]];

fn camera() -> DMat4 {
    perspective(0.9, 9.0 / 7.0, 0.1, 10.0)
}

fn fragments<T: Scalar>(tape: &Tape<T>, sampling: Sampling) -> Fragments<'_, T> {
    let positions = tape.leaf(&Tensor::<f64>::from(CORNERS).cast());
    let clip = project(positions, &camera(), None).unwrap();
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    rasterize(clip, &mesh, RasterOptions::new(SIZE).sampling(sampling).creases(&[])).unwrap()
}

/// How far along the view axis the ray through a pixel's centre meets the face.
fn traced(pixel: usize) -> f64 {
    let ratio = |k: usize, extent: usize| (2 * k + 1) as f64 / extent as f64 - 1.0;
    let Size { width, height } = SIZE;
    let ndc = [ratio(pixel % width, width), -ratio(pixel / width, height)];
    let inverse = camera().inverse();
    let ray = inverse.project_point3(DVec3::new(ndc[0], ndc[1], 0.0));
    let [a, b, c] = CORNERS.map(DVec3::from);
    let normal = (b - a).cross(c - a);
    -(ray * (normal.dot(a) / normal.dot(ray))).z
}

#[test]
fn it_is_the_distance_at_which_the_pixels_ray_meets_the_face() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Sampling::Center);
    let found = eye_depth(&fragments).unwrap().values().value();
    assert!(found.size() > 10);
    for (pixel, found) in fragments.coverage.pixels().zip(found.data()) {
        approx::assert_relative_eq!(*found, traced(pixel), max_relative = 1e-13);
    }
    let single = Tape::<f32>::new();
    let coarse = eye_depth(&self::fragments(&single, Sampling::Center)).unwrap().values();
    for (coarse, found) in coarse.value().data().iter().zip(found.data()) {
        approx::assert_relative_eq!(f64::from(*coarse), *found, max_relative = 1e-6);
    }
}

#[test]
fn its_slope_is_that_of_the_inverse_which_is_linear_over_the_image() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Sampling::Center);
    let slopes = eye_depth_slope(&fragments).unwrap().value();
    for (pixel, slopes) in fragments.coverage.pixels().zip(slopes.data().chunks_exact(2)) {
        let z = traced(pixel);
        for (step, slope) in [1, SIZE.width].into_iter().zip(slopes) {
            let inverse = traced(pixel + step).recip() - z.recip();
            approx::assert_relative_eq!(*slope, -z * z * inverse, max_relative = 1e-11);
        }
    }
}

#[test]
fn vertices_of_any_size_have_the_distances_of_their_w() {
    // A vertex times a number is seen at the same place, at another distance.
    let w = |scales: [f64; 3]| {
        let tape = Tape::<f64>::new();
        let places = [[-0.9, -0.8], [0.95, -0.7], [0.1, 0.9]];
        let clip = Tensor::from_flat_fn([3, 4], |k| {
            let [x, y] = places[k / 4];
            scales[k / 4] * [x, y, 0.0, 1.0][k % 4]
        });
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let fragments = rasterize(tape.leaf(&clip), &mesh, SIZE).unwrap();
        eye_depth(&fragments).unwrap().values().value().data().to_vec()
    };
    let expected = w([1.0, 2.0, 3.0]);
    for scale in [1e-200, 1e-70, 1e70, 1e200] {
        for (found, expected) in w([1.0, 2.0, 3.0].map(|w| scale * w)).iter().zip(&expected) {
            approx::assert_relative_eq!(*found, scale * expected, max_relative = 1e-13);
        }
    }
    // 1 / w is linear, so what is close to the first vertex is as close as it is.
    let near = w([1e-70, 1.0, 1.0]);
    let nearer = w([1e-72, 1.0, 1.0]);
    for (near, nearer) in near.iter().zip(nearer) {
        approx::assert_relative_eq!(near / nearer, 100.0, max_relative = 1e-12);
    }
}

#[test]
fn an_image_of_distances_is_far_where_nothing_is_seen() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Sampling::Center);
    for far in [7.5, f64::INFINITY] {
        let image = eye_depth(&fragments).unwrap().image(&fragments, far).unwrap();
        let image = image.distances().value();
        assert_eq!(**image.shape(), [7, 9]);
        for (pixel, &found) in image.data().iter().enumerate() {
            match fragments.coverage.fragment_at(pixel) {
                None => assert_eq!(found, far),
                Some(_) => assert!((found - traced(pixel)).abs() < 1e-12),
            }
        }
    }
}

#[test]
fn a_boundary_pixel_of_exact_coverage_has_the_mean_distance() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Sampling::Exact);
    let distances = eye_depth(&fragments).unwrap();
    let image = distances.image(&fragments, 7.5).unwrap().distances().value();
    let (values, weights) = (distances.values().value(), fragments.weight.unwrap().value());
    let centers = fragments.coverage.centers();
    let mut count = 0;
    for (pixel, pieces) in fragments.coverage.boundary() {
        let share = |piece: &u32| weights.data()[*piece as usize - centers];
        let seen: f64 = pieces.iter().map(|p| share(p) * values.data()[*p as usize]).sum();
        let rest = 1.0 - pieces.iter().map(share).sum::<f64>();
        approx::assert_relative_eq!(image.data()[pixel], seen + 7.5 * rest, epsilon = 1e-12);
        count += 1;
    }
    assert!(count > 10, "{count} boundary pixels");
}

#[test]
fn what_cannot_be_is_refused_with_rule_and_value() {
    let tape = Tape::<f64>::new();
    let (whole, _) = surface(&tape);
    let distances = eye_depth(&whole).unwrap();
    for far in [0.0, -1.0, f64::NAN] {
        let error = distances.image(&whole, far).unwrap_err().to_string();
        assert_eq!(error, format!("eye_depth needs a background at a distance above 0, got {far}"));
    }
    let exact = fragments(&tape, Sampling::Exact);
    let error = eye_depth(&exact).unwrap().image(&exact, f64::INFINITY).unwrap_err();
    let rule = "eye_depth needs a background at a finite distance above 0, got inf";
    assert_eq!(error.to_string(), rule);
    // Distances of other fragments.
    let count = whole.coverage.count();
    let error = eye_depth(&exact).unwrap().image(&whole, 1.0).unwrap_err().to_string();
    let rule = format!("composite needs values of shape [{count}, C], C > 0, got shape");
    assert!(error.starts_with(&rule), "{error}");
    let lost = Fragments { weight: None, ..exact };
    assert!(matches!(eye_depth(&lost), Err(RenderError::MissingWeights { .. })));
}
