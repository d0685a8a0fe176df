//! Strategies for inputs. Each aims at trouble: at the values where rounding, ties, kinks and
//! degenerate shapes are, more often than chance would have it.

mod image;
mod mesh;
mod tensor;
mod triangle;
mod view;

pub use image::{image, image_of, sigma};
pub use mesh::{ClosedMesh, closed_mesh};
pub use tensor::{around, broadcasting_shapes, non_zero, number, shape, tensor};
pub use triangle::{
    Triangle, aligned, any_size, degenerate, sliver, through_the_eye, triangle, well_shaped,
};
pub use view::{camera, unit_quaternion};

#[cfg(test)]
fn draws<T>(strategy: proptest::strategy::BoxedStrategy<T>, count: usize) -> Vec<T>
where
    T: std::fmt::Debug,
{
    use proptest::strategy::{Strategy as _, ValueTree as _};
    use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

    let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let mut runner = TestRunner::new_with_rng(Config::default(), rng);
    let mut draw = || strategy.new_tree(&mut runner).expect("a value").current();
    (0..count).map(|_| draw()).collect()
}
