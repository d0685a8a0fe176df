use bokashi_core::Tensor;
use bokashi_render_ops::PixelLoss;

#[test]
fn wrong_shapes_are_refused() {
    let image = Tensor::<f64>::zeros([4, 5, 3]);
    let error = PixelLoss::squared(&Tensor::zeros([4, 5]), &Tensor::<f64>::zeros([3]))
        .unwrap_err()
        .to_string();
    assert_eq!(error, "pixel_loss needs an image of shape [H, W, C], C > 0, got shape [4, 5]");
    let error = PixelLoss::squared(&image, &Tensor::zeros([1])).unwrap_err().to_string();
    assert_eq!(error, "pixel_loss needs a background of shape [3], got shape [1]");
}
