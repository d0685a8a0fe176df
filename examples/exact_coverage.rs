//! How does a disc's picture change as it grows? Its brightness is its area, so the answer is known:
//! twice the area over the radius. Pixel centres don't know it, antialiasing knows about it, exact
//! coverage knows it.
//!
//! Run with `cargo run --release --package bokashi-examples --example exact_coverage`.

use std::error::Error;
use std::f64::consts::PI;

use bokashi::prelude::*;

const CORNERS: u32 = 64;
const PIXELS: usize = 16;

/// A disc of `CORNERS` triangles of one brightness around a point off the middle, in clip space.
fn disc() -> Result<(Mesh, Tensor<f64>), Box<dyn Error>> {
    let around = |k: u32| 2.0 * PI * f64::from(k) / f64::from(CORNERS);
    let rim = (0..CORNERS).map(|k| [around(k).cos(), around(k).sin(), 0.0, 1.0]);
    let clip: Vec<f64> = std::iter::once([0.0, 0.0, 0.0, 1.0]).chain(rim).flatten().collect();
    let faces = (0..CORNERS).map(|k| [0, 1 + k, 1 + (k + 1) % CORNERS]).collect();
    let count = CORNERS as usize + 1;
    Ok((Mesh::new(faces, count)?, Tensor::new([count, 4], clip)?))
}

/// The brightness of the disc's picture, in pixels, and its derivative with respect to the radius.
fn brightness(radius: f64, silhouettes: Silhouettes) -> Result<[f64; 2], Box<dyn Error>> {
    let (mesh, unit) = disc()?;
    let tape = Tape::new();
    let radius = tape.leaf(&Tensor::scalar(radius));
    let scale = Tensor::new([4], vec![1.0, 1.0, 0.0, 0.0])?;
    let middle = Tensor::new([4], vec![0.03, -0.01, 0.0, 1.0])?;
    let clip = tape.constant(&unit) * tape.constant(&scale) * radius + tape.constant(&middle);
    let options = RasterOptions::new(Size::square(PIXELS)).silhouettes(silhouettes);
    let white = tape.constant(&Tensor::from_flat_fn([mesh.vertex_count(), 1], |_| 1.0));
    let sum = render(clip, &mesh, white, options, Background::Zero)?.image()?.sum();
    Ok([sum.item(), sum.backward()?.get_or_zeros(radius).data()[0]])
}

fn main() -> Result<(), Box<dyn Error>> {
    let (radius, half) = (0.61, 0.5 * PIXELS as f64);
    let area = 0.5 * f64::from(CORNERS) * (2.0 * PI / f64::from(CORNERS)).sin();
    let [truth, slope] = [area * radius * radius, 2.0 * area * radius].map(|x| x * half * half);
    println!("{:15} {truth:10.5} {slope:12.5}", "truth");
    for (name, silhouettes) in [
        ("pixel centres", Silhouettes::Aliased),
        ("antialias", Silhouettes::Antialias),
        ("exact coverage", Silhouettes::Exact),
    ] {
        let [value, derivative] = brightness(radius, silhouettes)?;
        println!("{name:15} {value:10.5} {derivative:12.5}");
    }
    Ok(())
}
