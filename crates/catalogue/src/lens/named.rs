//! The scenes that the lens was made on.

use super::scene::LensScene;

/// A scene by its name, and how a lens looks at it.
#[derive(Debug, Clone)]
pub struct Named {
    /// What is seen.
    pub name: String,
    /// Its surfaces.
    pub scene: LensScene,
    /// The aperture in pixels of a picture of 96, and the focus.
    pub numbers: [f64; 2],
    /// How far off `lens_picture` may be: the root mean square in percent of full intensity.
    pub reach: f64,
}

/// All of them.
pub fn named() -> Vec<Named> {
    let row =
        |name: &str, scene, numbers, reach| Named { name: name.to_owned(), scene, numbers, reach };
    vec![
        row("board in front", front_board(), [5.0, 4.0], 0.2),
        row("wall behind", front_board(), [10.0, 2.0], 0.7),
        row("slanted board on a floor", slope(), [7.0, 3.0], 1.2),
        row("two fences", fences(), [2.5, 8.0], 1.2),
        row("lamps", lamps(), [10.0, 3.0], 2.0),
        row("five balls", balls(), [8.0, 3.0], 0.8),
        row("pane with a hole", window(1.0), [6.0, 4.0], 1.0),
        row("clear pane with a hole", window(0.5), [6.0, 4.0], 1.0),
    ]
}

fn front_board() -> LensScene {
    let scene = LensScene::default();
    let scene = scene.wall(2.0, [[-0.5, 0.45], [-0.6, 0.4]], [4.0, 4.0], [0.7, 0.3]);
    scene.wall(4.0, [[-4.0, 4.0], [-4.0, 4.0]], [16.0, 12.0], [0.4, 0.6])
}

fn slope() -> LensScene {
    let floor = [[8.0, 0.0, 0.0], [0.0, 0.0, 5.0]];
    let scene = LensScene::default().board([-4.0, -0.7, 1.2], floor, [8.0, 2.0], [0.4, 0.6]);
    let sides = [[1.0, 0.0, 1.2], [0.1, 1.3, 0.3]];
    scene.board([-0.5, -0.7, 2.0], sides, [5.0, 5.0], [0.7, 0.3])
}

fn fences() -> LensScene {
    let mut scene = LensScene::default();
    for k in -5..=5 {
        let x = 0.3 * f64::from(k) + 0.05;
        scene = scene.wall(2.0, [[x, x + 0.14], [-2.0, 2.0]], [0.5, 10.0], [0.75, 0.3]);
        let y = 0.5 * f64::from(k) - 0.08;
        scene = scene.wall(4.0, [[-4.0, 4.0], [y, y + 0.25]], [14.0, 0.5], [0.3, 0.7]);
    }
    scene.wall(8.0, [[-8.0, 8.0], [-8.0, 8.0]], [20.0, 16.0], [0.5, 0.5])
}

/// Lamps many times as bright as white, a few pixels wide, some behind a board.
fn lamps() -> LensScene {
    let mut scene = LensScene::default();
    scene = scene.wall(2.0, [[-1.0, -0.2], [-0.5, 0.5]], [3.0, 4.0], [0.35, 0.4]);
    for k in 0..12 {
        let place = f64::from(k);
        let z = 4.0 + 0.45 * place;
        let [x, y] = [0.42 * z * (2.4 * place).sin(), 0.42 * z * (1.7 * place + 0.4).cos()];
        let half = 0.011 * z;
        let side = |middle: f64| [middle - half, middle + half];
        scene = scene.wall(z, [side(x), side(y)], [0.0, 0.0], [9.0, 6.0]);
    }
    scene.wall(10.0, [[-8.0, 8.0], [-8.0, 8.0]], [10.0, 8.0], [0.25, 0.3])
}

fn balls() -> LensScene {
    let scene = LensScene::default();
    let scene = scene.ball([-0.3, 0.2, 2.0], 0.35, [0.7, 0.3]);
    let scene = scene.ball([0.5, -0.1, 2.6], 0.4, [0.3, 0.65]);
    let scene = scene.ball([0.0, -0.8, 3.2], 0.5, [0.6, 0.6]);
    let scene = scene.ball([-1.0, -0.3, 4.2], 0.6, [0.45, 0.3]);
    scene.ball([0.9, 1.1, 5.5], 0.9, [0.3, 0.4])
}

/// A pane of this alpha with a hole, before a board and a wall.
fn window(alpha: f64) -> LensScene {
    let scene = LensScene::default();
    let scene = scene.wall(3.0, [[-0.2, 0.9], [-0.9, 0.3]], [6.0, 5.0], [0.3, 0.7]);
    let scene = scene.wall(4.0, [[-4.0, 4.0], [-4.0, 4.0]], [16.0, 12.0], [0.4, 0.6]);
    let sides = [[2.6, 0.0, 0.3], [0.1, 2.6, 0.0]];
    let frame = |scene: LensScene| scene.frame([-1.35, -1.3, 1.9], sides, [6.0, 6.0], [0.75, 0.3]);
    if alpha < 1.0 { scene.pane(alpha, frame) } else { frame(scene) }
}
