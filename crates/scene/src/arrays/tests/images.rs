//! Images of the crate `image`, and tensors of their light.

use bokashi_core::Tensor;
use image::{DynamicImage, GrayImage, ImageBuffer, Luma, LumaA, Rgb, RgbImage, Rgba};

use super::*;
use crate::picture::{ColorSpace, Depth};

#[test]
fn every_byte_and_every_sixteen_bits_survive_the_way_to_light_and_back() {
    let bytes = GrayImage::from_raw(16, 16, (0..=255).collect()).unwrap();
    let wide: ImageBuffer<Luma<u16>, _> =
        ImageBuffer::from_raw(256, 256, (0..=65535).collect()).unwrap();
    for space in [ColorSpace::Srgb, ColorSpace::Linear] {
        let image = DynamicImage::from(bytes.clone());
        let light = tensor_of_image(image.clone(), space).unwrap();
        assert_eq!(**light.shape(), [16, 16, 1]);
        assert_eq!(image_of(&light, space, Depth::Eight).unwrap(), image);
        let image = DynamicImage::from(wide.clone());
        let light = tensor_of_image(image.clone(), space).unwrap();
        assert_eq!(image_of(&light, space, Depth::Sixteen).unwrap(), image);
    }
}

#[test]
fn colours_have_the_curve_and_opacity_has_none() {
    let image = RgbImage::from_pixel(1, 1, Rgb([0, 188, 255]));
    let light = tensor_of_image(image.clone(), ColorSpace::Srgb).unwrap();
    approx::assert_abs_diff_eq!(light.data(), &[0.0, 0.5029, 1.0][..], epsilon = 1e-4);
    let image = ImageBuffer::from_pixel(1, 1, Rgba([0_u8, 188, 255, 188]));
    let light = tensor_of_image(image.clone(), ColorSpace::Srgb).unwrap();
    approx::assert_abs_diff_eq!(light.data(), &[0.0, 0.5029, 1.0, 0.73725][..], epsilon = 1e-4);
    assert_eq!(image_of(&light, ColorSpace::Srgb, Depth::Eight).unwrap(), image.into());
    let image = ImageBuffer::from_pixel(1, 1, LumaA([48316_u16, 48316]));
    let light = tensor_of_image(image.clone(), ColorSpace::Srgb).unwrap();
    approx::assert_abs_diff_eq!(light.data(), &[0.5029, 0.73725][..], epsilon = 1e-4);
    assert_eq!(image_of(&light, ColorSpace::Srgb, Depth::Sixteen).unwrap(), image.clone().into());
    let light = tensor_of_image(image, ColorSpace::Linear).unwrap();
    assert_eq!(light.data()[0], light.data()[1]);
}

#[test]
fn thirty_two_bits_stay_what_they_are() {
    let odd = vec![-0.0, f32::NAN, f32::INFINITY, 1e-40, -7.0, 2.5];
    let image = ImageBuffer::<Rgb<f32>, _>::from_raw(2, 1, odd.clone()).unwrap();
    let light = tensor_of_image(image.clone(), ColorSpace::Linear).unwrap();
    let bits = |numbers: &[f32]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(light.data()), bits(&odd));
    let back = image_of(&light, ColorSpace::Linear, Depth::ThirtyTwo).unwrap();
    assert_eq!(bits(back.as_rgb32f().unwrap().as_raw()), bits(&odd));
    // With a curve they go beyond 0 and 1, too.
    let light = Tensor::new([1, 1, 4], vec![-0.2140411, 0.2140411, 4.953848, 0.3]).unwrap();
    let image = image_of(&light, ColorSpace::Srgb, Depth::ThirtyTwo).unwrap();
    let found = image.as_rgba32f().unwrap().as_raw();
    approx::assert_abs_diff_eq!(&found[..], &[-0.5, 0.5, 2.0, 0.3][..], epsilon = 1e-5);
}

#[test]
fn light_is_clamped_and_rounded_to_eight_and_sixteen_bits() {
    let light = Tensor::new([1, 4], vec![-1.0, f32::NAN, 7.0, 0.5]).unwrap();
    let image = image_of(&light, ColorSpace::Linear, Depth::Eight).unwrap();
    assert_eq!(image.as_luma8().unwrap().as_raw(), &[0, 0, 255, 128]);
    let image = image_of(&light, ColorSpace::Linear, Depth::Sixteen).unwrap();
    assert_eq!(image.as_luma16().unwrap().as_raw(), &[0, 0, 65535, 32768]);
}

#[test]
fn each_number_of_channels_has_its_buffer() {
    for channels in 1..=4 {
        let light = Tensor::from_flat_fn([2, 3, channels], |k| k as f32 / 24.0);
        for depth in [Depth::Eight, Depth::Sixteen, Depth::ThirtyTwo] {
            let found = image_of(&light, ColorSpace::Linear, depth);
            if depth == Depth::ThirtyTwo && channels < 3 {
                let message = found.unwrap_err().to_string();
                let rule = "an image: an image of 32 bits has three or four channels";
                assert_eq!(message, format!("{rule}, and this has {channels}"));
                continue;
            }
            let image = found.unwrap();
            assert_eq!((image.width(), image.height()), (3, 2));
            assert_eq!(usize::from(image.color().channel_count()), channels);
            let back = tensor_of_image(image.clone(), ColorSpace::Linear).unwrap();
            assert_eq!(back.shape(), light.shape());
            approx::assert_abs_diff_eq!(back.data(), light.data(), epsilon = 2e-3);
        }
    }
    let no_image = Tensor::<f32>::zeros([2, 3, 5]);
    assert!(image_of(&no_image, ColorSpace::Linear, Depth::Eight).is_err());
    let message = tensor_of_image(GrayImage::new(0, 3), ColorSpace::Linear).unwrap_err();
    let expected = "an image: an image has pixels, of one to four channels, and this is 0 x 3 of 1";
    assert_eq!(message.to_string(), expected);
}
