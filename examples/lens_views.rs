//! What does a lens see? The mean of what its points see, each from a little aside: one line on clip positions, and
//! with exact silhouettes its gradients are true. `lens_picture` takes one view and a few blurs instead.

use std::error::Error;
use std::f64::consts::PI;

use bokashi::prelude::*;

const SIZE: Size = Size { width: 64, height: 64 };
const MARGIN: usize = 10;
/// The focal length of the camera in pixels, and how far the background is away.
const FOCAL_LENGTH: f64 = 70.0;
const FAR: f64 = 20.0;

/// A mesh, its clip positions, and colours.
type Boards = (Mesh, Tensor<f64>, Tensor<f64>);

/// Two boards, the nearer one in front of the other, in a picture of `size`.
fn boards(size: Size) -> Result<Boards, Box<dyn Error>> {
    let (mut clip, mut colors) = (Vec::new(), Vec::new());
    for ([left, right, bottom, top], z, color) in
        [([-0.5, 0.3, -0.6, 0.2], 2.0, 0.9), ([-0.9, 1.2, -0.8, 1.1], 4.0, 0.3)]
    {
        for (x, y) in [(left, bottom), (right, bottom), (left, top), (right, top)] {
            let [width, height] = [size.width, size.height].map(|pixels| pixels as f64);
            let scale = 2.0 * FOCAL_LENGTH;
            clip.push([scale / width * x, scale / height * y, z - 0.2, z]);
            colors.push([color, 0.5 + 0.3 * x]);
        }
    }
    let square = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4)?;
    let mesh = Assembly::new(&[(&square, 2)])?.mesh().clone();
    Ok((mesh, Tensor::from(clip), Tensor::from(colors)))
}

/// Where clip positions lie for the point `[p_x, p_y]` of the unit disc: what is `w` away moves by `p` times its
/// circle of confusion, so that what is in focus stays.
fn seen_from<'t>(
    clip: Var<'t, f64>,
    lens: ThinLens<'t, f64>,
    [x, y]: [f64; 2],
) -> Result<Var<'t, f64>, TensorError> {
    let point = [2.0 * x / SIZE.width as f64, 2.0 * y / SIZE.height as f64, 0.0, 0.0];
    let row = clip.tape().constant(&Tensor::new([1, 4], point.to_vec())?);
    let distance = clip.slice(1, 3..4)?;
    Ok(clip - ((distance - lens.focus) * lens.aperture).matmul(row)?)
}

/// The mean of what `count` points of the lens see.
fn views(lens: ThinLens<'_, f64>, count: usize) -> Result<Var<'_, f64>, Box<dyn Error>> {
    let tape = lens.focus.tape();
    let (mesh, clip, colors) = boards(SIZE)?;
    let (clip, colors) = (tape.constant(&clip), tape.constant(&colors));
    let options = RasterOptions::new(SIZE).silhouettes(Silhouettes::Exact);
    let mut sum = tape.constant_full([SIZE.height, SIZE.width, 2], 0.0);
    for k in 0..count {
        // Points on a spiral share the disc evenly.
        let radius = ((k as f64 + 0.5) / count as f64).sqrt();
        let angle = k as f64 * PI * (3.0 - 5.0_f64.sqrt());
        let clip = seen_from(clip, lens, [radius * angle.cos(), radius * angle.sin()])?;
        sum = sum + render(clip, &mesh, colors, options, Background::Zero)?.image()?;
    }
    Ok(sum * (count as f64).recip())
}

/// What `lens_picture` makes of one rasterization, and of what it hides.
fn drawn(lens: ThinLens<'_, f64>) -> Result<Var<'_, f64>, Box<dyn Error>> {
    let tape = lens.focus.tape();
    let size = Size { width: SIZE.width + 2 * MARGIN, height: SIZE.height + 2 * MARGIN };
    let (mesh, clip, colors) = boards(size)?;
    let (clip, colors) = (tape.constant(&clip), tape.constant(&colors));
    let exact = RasterOptions::new(size).silhouettes(Silhouettes::Exact);
    let visible = rasterize(clip, &mesh, exact.creases(&[colors.into()]))?;
    let hidden = depth_layers(clip, &mesh, size, Some(2))?;
    let layer = |fragments| -> Result<_, RenderError> {
        let premultiplied = interpolate(colors, fragments)?;
        let alpha = tape.constant_full([fragments.coverage.count()], 1.0);
        LensLayer::from_fragments(fragments, premultiplied, alpha)
    };
    let behind = hidden.iter().map(layer).collect::<Result<Vec<_>, _>>()?;
    let options = ThinLensOptions { margin: MARGIN, ..ThinLensOptions::default() };
    Ok(lens_picture(layer(&visible)?, &behind, Background::Zero, FAR, lens, &options)?.image)
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("{:12} {:>8} {:>11} {:>8}", "", "contrast", "by aperture", "by focus");
    for count in [16, 64, 256, 0] {
        let tape = Tape::new();
        let lens = ThinLens { aperture: tape.leaf_scalar(6.0), focus: tape.leaf_scalar(2.5) };
        let image = if count > 0 { views(lens, count)? } else { drawn(lens)? };
        let contrast = image.square().mean()?;
        let gradients = contrast.backward()?;
        let [by_aperture, by_focus] =
            [lens.aperture, lens.focus].map(|number| gradients.get_or_zeros(number).item());
        let name = if count > 0 { format!("{count} views") } else { "lens_picture".to_owned() };
        println!("{name:12} {:8.5} {by_aperture:11.6} {by_focus:8.5}", contrast.item());
    }
    Ok(())
}
