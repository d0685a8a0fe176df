//! Images made smaller.

use bokashi_core::Tensor;

/// Means over `k` x `k` pixels of an image `[H, W, C]` or `[H, W]`; what is left at the right and below is
/// cut off.
pub(crate) fn reduced(image: &Tensor<f32>, k: usize) -> Tensor<f32> {
    let shape = image.shape().to_vec();
    let channels = shape.get(2).copied().unwrap_or(1);
    let [height, width] = [(shape[0] / k).max(1), (shape[1] / k).max(1)];
    let [rows, columns] = [k.min(shape[0]), k.min(shape[1])];
    let data = image.data();
    let mut small = vec![0.0_f32; height * width * channels];
    for (index, mean) in small.iter_mut().enumerate() {
        let (pixel, channel) = (index / channels, index % channels);
        let (row, column) = (pixel / width * k, pixel % width * k);
        let block = (0..rows * columns).map(|n| {
            let (row, column) = (row + n / columns, column + n % columns);
            f64::from(data[(row * shape[1] + column) * channels + channel])
        });
        *mean = (block.sum::<f64>() / (rows * columns) as f64) as f32;
    }
    let mut small_shape = shape;
    (small_shape[0], small_shape[1]) = (height, width);
    Tensor::from_flat_fn(small_shape.as_slice(), |index| small[index])
}
