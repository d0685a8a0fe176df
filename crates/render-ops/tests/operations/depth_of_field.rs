//! Laws of depth of field.

use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, DepthImage, Focused, Iris, Lens, LensLayer, LensOptions, Mesh, Radius,
    RenderError, Size, ThinLens, ThinLensOptions, composite, depth_of_field, gaussian_blur,
    lens_picture, rasterize,
};

const SHAPE: [usize; 3] = [6, 9, 2];

fn image(seed: usize) -> Tensor<f64> {
    Tensor::from_flat_fn(SHAPE, |k| ((k * 7919 + seed * 104_729) % 1009) as f64 / 1009.0 - 0.4)
}

/// Depths on both sides of the focus at 3, and one pixel at infinity.
fn depths() -> Tensor<f64> {
    Tensor::from_flat_fn([6, 9], |k| match k {
        20 => f64::INFINITY,
        k => 0.8 + 0.37 * ((k * 31) % 17) as f64,
    })
}

/// The image, and `<u, image>` for a motley u.
fn focused(
    image: &Tensor<f64>,
    depth: &Tensor<f64>,
    [aperture, focus]: [f64; 2],
    options: &LensOptions,
) -> (Tensor<f64>, f64, usize) {
    let tape = Tape::new();
    let (image, depth) = (tape.leaf(image), tape.leaf(depth));
    let (aperture, focus) = (tape.leaf_scalar(aperture), tape.leaf_scalar(focus));
    let lens = Lens { aperture, focus };
    let found = depth_of_field(image, DepthImage::from_distances(depth), lens, options).unwrap();
    let value = found.image.value();
    let product = value.data().iter().zip(upstream().data()).map(|(b, u)| b * u).sum();
    (value, product, found.capped)
}

/// [`depth_of_field`], by its four variables.
fn focused_variables<'t>(
    image: Var<'t, f64>,
    depth: Var<'t, f64>,
    aperture: Var<'t, f64>,
    focus: Var<'t, f64>,
    options: &LensOptions,
) -> Result<Focused<'t, f64>, RenderError> {
    depth_of_field(image, DepthImage::from_distances(depth), Lens { aperture, focus }, options)
}

fn upstream() -> Tensor<f64> {
    image(5)
}

fn assert_close(found: &Tensor<f64>, expected: &Tensor<f64>, tolerance: f64) {
    assert_eq!(found.shape(), expected.shape());
    for (found, expected) in found.data().iter().zip(expected.data()) {
        assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
    }
}

/// Windows, and ladders of two spacings.
const WAYS: [Radius; 4] =
    [Radius::Fixed(5), Radius::Tolerance(1e-14), Radius::Tolerance(1e-3), Radius::Tolerance(1e-2)];

#[test]
fn at_one_depth_it_is_the_gaussian_blur() {
    for (tolerance, within) in [(1e-7, 1e-14), (1e-4, 1e-4), (1e-3, 1e-3), (1e-2, 1e-2)] {
        let radius = Radius::Tolerance(tolerance);
        let options = LensOptions { radius, ..LensOptions::default() };
        // The ladder is held against windows that miss nothing.
        let radius = Radius::Tolerance(if tolerance < 1e-5 { tolerance } else { 1e-12 });
        let blur = Blur { radius, ..Blur::default() };
        for (depth, sigma) in [(6.0, 1.0), (1.5, 2.0), (f64::INFINITY, 2.0), (3.1, 2.0 / 31.0)] {
            let tape = Tape::new();
            let blurred = gaussian_blur(tape.leaf(&image(1)), tape.leaf_scalar(sigma), &blur);
            let expected = blurred.unwrap().value();
            let (found, ..) =
                focused(&image(1), &Tensor::full([6, 9], depth), [2.0, 3.0], &options);
            assert_close(&found, &expected, within);
        }
    }
}

#[test]
fn a_ladder_is_within_its_tolerance_of_windows() {
    // Random signs are the image that shows errors of weights best; 61 x 47 pixels hold the windows.
    let shape = [47, 61, 1];
    let image = Tensor::from_flat_fn(shape, |k| {
        let bits = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        if (bits ^ bits >> 31).count_ones().is_multiple_of(2) { 0.0 } else { 1.0 }
    });
    for tolerance in [1e-2, 1e-3, 1e-4] {
        for aperture in [0.3, 0.7, 3.0] {
            // Standard deviations from 0 at the left to the aperture at the right.
            let depth = Tensor::from_flat_fn([47, 61], |k| 60.0 / (60.0 - (k % 61) as f64));
            let [found, expected] = [tolerance, 1e-12].map(|tolerance| {
                let radius = Radius::Tolerance(tolerance);
                let options = LensOptions { radius, ..LensOptions::default() };
                let tape = Tape::<f64>::new();
                let lens =
                    Lens { aperture: tape.leaf_scalar(aperture), focus: tape.leaf_scalar(1.0) };
                let depth = DepthImage::from_distances(tape.leaf(&depth));
                let out = depth_of_field(tape.leaf(&image), depth, lens, &options).unwrap().image;
                let bars = tape.vjp(&[(out, &image)]).unwrap();
                (out.value(), bars.get(lens.aperture).unwrap().item())
            });
            assert_close(&found.0, &expected.0, tolerance);
            let scale = expected.0.size() as f64;
            assert!((found.1 - expected.1).abs() < 3.0 * tolerance * scale);
        }
    }
}

#[test]
fn a_step_back_through_a_ladder_is_its_transpose() {
    // <u, B c> = <B^T u, c> for a band of rows at a time: more rows than a band has.
    let shape = [40, 2100, 1];
    let entry = |seed: usize| {
        Tensor::<f64>::from_flat_fn(shape, |k| ((k * 7919 + seed * 104_729) % 1009) as f64 - 504.0)
    };
    let depth = Tensor::from_flat_fn([40, 2100], |k| 0.9 + ((k * 31) % 1013) as f64 / 200.0);
    let tape = Tape::<f64>::new();
    let lens = Lens { aperture: tape.leaf_scalar(2.0), focus: tape.leaf_scalar(2.0) };
    let (image, u) = (tape.leaf(&entry(1)), entry(2));
    let depth = DepthImage::from_distances(tape.leaf(&depth));
    let out = depth_of_field(image, depth, lens, &LensOptions::default()).unwrap().image;
    let image_bar = tape.vjp(&[(out, &u)]).unwrap().get(image).unwrap().clone();
    let dot = |a: &Tensor<f64>, b: &Tensor<f64>| -> f64 {
        a.data().iter().zip(b.data()).map(|(a, b)| a * b).sum()
    };
    let (forward, back) = (dot(&u, &out.value()), dot(&image_bar, &entry(1)));
    assert!((forward - back).abs() < 1e-12 * dot(&u, &u), "{forward} and {back}");
}

#[test]
fn what_is_in_focus_stays_as_it_is_to_the_bit() {
    let mut depth = depths();
    for k in (0..54).step_by(3) {
        depth.data_mut()[k] = 3.0;
    }
    for radius in WAYS {
        let options = LensOptions { radius, ..LensOptions::default() };
        let (found, ..) = focused(&image(1), &depth, [2.0, 3.0], &options);
        let pairs = found.data().iter().zip(image(1).data().to_vec()).enumerate();
        for (k, (&found, sharp)) in pairs {
            let sigma = 2.0 * (1.0 - 3.0 / depth.data()[k / 2]).abs();
            if sigma == 0.0 {
                assert_eq!(found, sharp, "entry {k}");
            } else if sigma > 0.3 {
                assert_ne!(found, sharp, "entry {k}");
            }
        }
    }
}

#[test]
fn windows_keep_a_constant_image_to_the_bit_and_it_moves_with_nothing() {
    let options = LensOptions { radius: Radius::Fixed(6), ..LensOptions::default() };
    let tape = Tape::new();
    let image = tape.leaf(&Tensor::full(SHAPE, 0.7));
    let (depth, aperture, focus) =
        (tape.leaf(&depths()), tape.leaf_scalar(2.0), tape.leaf_scalar(3.0));
    let out = focused_variables(image, depth, aperture, focus, &options).unwrap().image;
    assert_eq!(out.value(), image.value());
    let gradients = tape.vjp(&[(out, &upstream())]).unwrap();
    for leaf in [depth, aperture, focus] {
        assert!(gradients.get(leaf).unwrap().data().iter().all(|&bar| bar == 0.0));
    }
}

#[test]
fn a_ladder_keeps_a_constant_image_to_rounding() {
    let (found, product, _) =
        focused(&Tensor::full(SHAPE, 0.7), &depths(), [2.0, 3.0], &LensOptions::default());
    assert!(found.data().iter().all(|found| (found - 0.7).abs() < 1e-15));
    let sum: f64 = upstream().data().iter().sum();
    assert!((product - 0.7 * sum).abs() < 1e-13);
}

#[test]
fn an_aperture_of_zero_is_the_image_itself_and_leaves_no_trace() {
    let tape = Tape::<f64>::new();
    let (image, depth) = (tape.leaf(&image(1)), tape.leaf(&depths()));
    let (aperture, focus) = (tape.leaf_scalar(0.0), tape.leaf_scalar(3.0));
    let before = tape.len();
    let out =
        focused_variables(image, depth, aperture, focus, &LensOptions::default()).unwrap().image;
    assert_eq!(tape.len(), before);
    assert_eq!(out.value().data().as_ptr(), image.value().data().as_ptr());
    assert!(format!("{:?}", tape.take_report()).contains("aperture is 0"));
}

#[test]
fn near_the_eye_the_blur_is_capped_and_counted() {
    let options = LensOptions { largest_sigma: 4.0, ..LensOptions::default() };
    for (depth, capped) in [(0.0, 54), (1e-300, 54), (1.0, 0), (0.999, 54), (2.0, 0)] {
        // sigma = 2 |1 - 3 / z| is 4 at z = 1.
        let depth = Tensor::full([6, 9], depth);
        let (found, _, count) = focused(&image(1), &depth, [2.0, 3.0], &options);
        assert_eq!(count, capped);
        assert!(found.is_finite());
    }
    let tape = Tape::new();
    let (image, depth) = (tape.leaf(&image(1)), tape.leaf(&Tensor::zeros([6, 9])));
    let (aperture, focus) = (tape.leaf_scalar(2.0), tape.leaf_scalar(3.0));
    let out = focused_variables(image, depth, aperture, focus, &options).unwrap().image;
    let gradients = tape.vjp(&[(out, &upstream())]).unwrap();
    for leaf in [depth, aperture, focus] {
        assert!(gradients.get_or_zeros(leaf).data().iter().all(|&bar| bar == 0.0));
    }
}

#[test]
fn a_pixel_at_infinity_has_no_gradient_in_its_depth() {
    for radius in WAYS {
        let options = LensOptions { radius, largest_sigma: 5.0, iris: None };
        let tape = Tape::new();
        let (image, depth) = (tape.leaf(&image(1)), tape.leaf(&depths()));
        let (aperture, focus) = (tape.leaf_scalar(2.0), tape.leaf_scalar(3.0));
        let found = focused_variables(image, depth, aperture, focus, &options).unwrap();
        assert_eq!(found.capped, (0..54).filter(|&k| depths().data()[k] < 6.0 / 7.0).count());
        let depth_bar = tape.vjp(&[(found.image, &upstream())]).unwrap().get_or_zeros(depth);
        assert!(depth_bar.is_finite() && depth_bar.data()[20] == 0.0);
    }
}

const IRISES: [Iris; 3] = [
    Iris::Disc,
    Iris::Polygon { blades: 3, rotation: 0.4 },
    Iris::Polygon { blades: 6, rotation: 0.0 },
];

#[test]
fn a_wall_through_an_iris_is_what_a_lens_sees_of_it() {
    let size = Size { width: 37, height: 34 };
    let count = size.pixels();
    let colors = Tensor::<f64>::from_flat_fn([count, 2], |k| ((k * 7919) % 1009) as f64 / 1009.0);
    // Circles below a pixel, of a few on both sides of the focus, and so wide that they are drawn at half the size.
    for (depth, aperture) in [(2.9, 2.0), (1.5, 2.1), (9.0, 3.3), (1.0, 4.1), (f64::INFINITY, 9.0)]
    {
        for iris in IRISES {
            let tape = Tape::<f64>::new();
            let corners = [-1.0, -1.0, 0.0, 1.0, 3.0, -1.0, 0.0, 1.0, -1.0, 3.0, 0.0, 1.0];
            let clip = tape.constant(&Tensor::new([3, 4], corners.to_vec()).unwrap());
            let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
            let fragments = rasterize(clip, &mesh, size).unwrap();
            let colors = tape.leaf(&colors);
            let layer = LensLayer {
                fragments: &fragments,
                premultiplied: colors,
                alpha: tape.constant(&Tensor::full([count], 1.0)),
                distance: tape.constant(&Tensor::full([count], depth)),
                slope: None,
            };
            let focus = tape.leaf_scalar(3.0);
            let lens = ThinLens { aperture: tape.leaf_scalar(2.0 * aperture), focus };
            let options = ThinLensOptions { iris, ..ThinLensOptions::default() };
            let seen =
                lens_picture(layer, &[layer], Background::Zero, f64::INFINITY, lens, &options);
            let expected = seen.unwrap().image;

            let sharp = composite(colors, &fragments, Background::Zero).unwrap();
            let image = sharp.image().unwrap();
            let distances = DepthImage::from_distances(tape.leaf(&Tensor::full([34, 37], depth)));
            let own = Lens { aperture: tape.leaf_scalar(aperture), focus };
            let options = LensOptions { iris: Some(iris), ..LensOptions::default() };
            let found = depth_of_field(image, distances, own, &options).unwrap().image;
            assert_close(&found.value(), &expected.value(), 1e-12);

            let upstream = Tensor::from_flat_fn([34, 37, 2], |k| ((k * 31) % 101) as f64 - 50.0);
            let gradients = tape.vjp(&[(found, &upstream)]).unwrap();
            let others = tape.vjp(&[(expected, &upstream)]).unwrap();
            assert_close(gradients.get(colors).unwrap(), others.get(colors).unwrap(), 1e-10);
            let slope = 2.0 * others.get(lens.aperture).unwrap().item();
            let found = gradients.get(own.aperture).unwrap().item();
            assert!((found - slope).abs() < 1e-8 * (1.0 + slope.abs()), "{found}, {slope}");
        }
    }
}

#[test]
fn what_an_iris_sees_in_focus_stays_as_it_is_to_the_bit() {
    let mut depth = depths();
    (0..54).step_by(3).for_each(|k| depth.data_mut()[k] = 3.0);
    for iris in IRISES {
        let options = LensOptions { iris: Some(iris), ..LensOptions::default() };
        let (found, ..) = focused(&image(1), &depth, [2.0, 3.0], &options);
        for k in (0..54).step_by(3) {
            assert_eq!(found.data()[2 * k..][..2], image(1).data()[2 * k..][..2]);
        }
    }
}
