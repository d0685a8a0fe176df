//! What is blurred without an image is what is blurred with it.

use bokashi_core::{Scalar, Tape, Tensor, squared_error};
use bokashi_render_ops::{
    Background, Blur, Border, Fragments, Kernel, Mesh, PixelLoss, Radius, RasterOptions, Sampling,
    Size, antialias, composite, gaussian_blur, rasterize,
};

const SMALL: Size = Size { width: 24, height: 17 };
/// Of three bands, and as many chunks.
const LARGE: Size = Size { width: 150, height: 290 };

/// Two faces, one in front of the other, the first of them across a border of the image.
fn fragments<T: Scalar>(tape: &Tape<T>, size: Size, sampling: Sampling) -> Fragments<'_, T> {
    let clip = [
        [-0.9, -0.8, 0.2, 1.0],
        [0.7, -0.6, 0.3, 1.1],
        [-0.1, 1.3, 0.1, 0.9],
        [0.9, 0.7, 0.0, 1.2],
        [-0.3, 0.1, -0.2, 1.0],
        [0.2, -0.7, 0.1, 1.0],
    ];
    let clip = tape.leaf(&Tensor::from_flat_fn([6, 4], |k| T::from_f64(clip[k / 4][k % 4])));
    let mesh = Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap();
    rasterize(clip, &mesh, RasterOptions::new(size).sampling(sampling).creases(&[])).unwrap()
}

fn numbers<T: Scalar>(shape: &[usize]) -> Tensor<T> {
    Tensor::from_flat_fn(shape, |k| T::from_f64((k * 37 % 101) as f64 / 101.0 - 0.2))
}

/// The results, as bits: an image or an error, and gradients.
type Bits = Vec<Option<Vec<u64>>>;

fn bits<T: Scalar>(tensor: &Tensor<T>) -> Option<Vec<u64>> {
    Some(tensor.data().iter().map(|entry| entry.to_f64().to_bits()).collect())
}

/// What is blurred, the background's kind, and what is learnt.
#[derive(Debug, Clone, Copy)]
struct Case {
    size: Size,
    sampling: Sampling,
    blur: Blur,
    sigma: f64,
    background: usize,
    learns: [bool; 2],
}

fn squared_error_against<T: Scalar>(reference: &Tensor<T>) -> PixelLoss<T> {
    PixelLoss::squared(reference, &Tensor::zeros([reference.shape()[2]])).unwrap()
}

/// Image and error of a case, each with its gradients: of rows, or of the image.
fn results<T: Scalar>(case: Case, is_by_rows: bool) -> Bits {
    let Case { size, sampling, blur, sigma, background, learns } = case;
    let tape = Tape::new();
    let fragments = fragments::<T>(&tape, size, sampling);
    let values = numbers(&[fragments.coverage.count(), 2]);
    let values = if learns[0] { tape.leaf(&values) } else { tape.constant(&values) };
    let fragments = if learns[0] { fragments } else { fragments.constant().on(&tape) };
    let sigma = Tensor::scalar(T::from_f64(sigma));
    let sigma = if learns[1] { tape.leaf(&sigma) } else { tape.constant(&sigma) };
    let [color, shape] = [numbers(&[2]), numbers(&[size.height, size.width, 2])];
    let background = match background {
        0 => Background::Zero,
        1 => Background::Color(tape.constant(&color)),
        2 => Background::Color(tape.leaf(&color)),
        _ => Background::Image(tape.constant(&shape)),
    };
    let picture = composite(values, &fragments, background).unwrap();
    let picture = match sampling {
        Sampling::Center => antialias(picture).unwrap(),
        _ => picture.into(),
    };
    let upstream = shape.map(|entry: T| entry * entry);
    let (image, error) = if is_by_rows {
        let blurred = picture.blurred(sigma, &blur);
        let error = blurred.loss(&squared_error_against(&upstream)).unwrap();
        (blurred.image().unwrap(), error)
    } else {
        let blurred = || gaussian_blur(picture.image().unwrap(), sigma, &blur).unwrap();
        (blurred(), squared_error(blurred(), tape.constant(&upstream)).unwrap())
    };
    let mut found = vec![bits(&image.value()), bits(&error.value())];
    let mut wanted = vec![values, fragments.clip, sigma];
    if let Background::Color(color) | Background::Image(color) = background {
        wanted.push(color);
    }
    let halves = Tensor::scalar(T::from_f64(0.5));
    for seeds in [(image, &shape), (error, &Tensor::scalar(T::ONE)), (error, &halves)] {
        let gradients = tape.vjp(&[seeds]).unwrap();
        found.extend(wanted.iter().map(|&of| gradients.get(of).and_then(bits)));
    }
    found
}

fn assert_same(case: Case) {
    let [found, expected] = [true, false].map(|by_rows| results::<f64>(case, by_rows));
    assert!(found == expected, "{case:?}");
    let [found, expected] = [true, false].map(|by_rows| results::<f32>(case, by_rows));
    assert!(found == expected, "f32, {case:?}");
}

#[test]
fn a_blurred_picture_is_its_blurred_image_to_the_bit() {
    let usual = Case {
        size: SMALL,
        sampling: Sampling::Center,
        blur: Blur { radius: Radius::Fixed(5), ..Blur::default() },
        sigma: 1.3,
        background: 1,
        learns: [true; 2],
    };
    assert_same(Case { blur: Blur { kernel: Kernel::Disc, ..Blur::default() }, ..usual });
    for kernel in [Kernel::Unnormalized, Kernel::Sampled, Kernel::Discrete] {
        for border in [Border::Zero, Border::Mirror, Border::Clamp] {
            for radius in [Radius::Fixed(0), Radius::Fixed(60), Radius::Tolerance(1e-4)] {
                let blur = Blur { kernel, border, radius };
                assert_same(Case { blur, ..usual });
                // Wide enough for tridiagonal systems, where a kernel has them.
                assert_same(Case { blur, sigma: 20.0, ..usual });
            }
        }
    }
    for sampling in [Sampling::Center, Sampling::Exact] {
        for background in 0..4 {
            for learns in [[true, true], [true, false], [false, true], [false, false]] {
                assert_same(Case { sampling, background, learns, ..usual });
            }
        }
    }
    assert_same(Case { sigma: 0.0, blur: Blur::default(), ..usual });
    for border in [Border::Zero, Border::Mirror] {
        for radius in [3, 200] {
            let blur = Blur { border, radius: Radius::Fixed(radius), ..usual.blur };
            assert_same(Case { size: LARGE, blur, ..usual });
        }
        let blur = Blur { border, ..usual.blur };
        assert_same(Case { size: LARGE, learns: [false, true], blur, ..usual });
    }
}

#[test]
fn what_a_blur_refuses_is_refused_and_so_is_a_reference_of_another_shape() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, SMALL, Sampling::Center);
    let values = tape.leaf(&numbers(&[fragments.coverage.count(), 2]));
    let picture = composite(values, &fragments, Background::Zero).unwrap();
    let blur = Blur::default();
    let [two, negative] = [tape.leaf_full([2], 1.0), tape.leaf_scalar(-1.0)];
    let image = picture.image().unwrap();
    let reference = image.value();
    for sigma in [two, negative] {
        let expected = gaussian_blur(image, sigma, &blur).unwrap_err().to_string();
        let blurred = picture.blurred(sigma, &blur);
        assert_eq!(blurred.image().unwrap_err().to_string(), expected);
        let found = blurred.loss(&squared_error_against(&reference)).unwrap_err();
        assert_eq!(found.to_string(), expected);
    }
    let (blurred, wrong) =
        (picture.blurred(tape.leaf_scalar(1.0), &blur), Tensor::zeros([17, 24, 3]));
    let error = blurred.loss(&squared_error_against(&wrong)).unwrap_err().to_string();
    assert_eq!(error, "pixel_loss needs a background of shape [2], got shape [3]");
}
