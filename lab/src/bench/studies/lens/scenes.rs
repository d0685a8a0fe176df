//! Scenes on which nothing of the lens was chosen: random ones, and some of other kinds.

use bokashi_catalogue::lens::{LensScene, Named, named};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// How many random scenes there are.
pub(super) const RANDOM: u64 = 20;
/// The widest circle of confusion, in pixels: a picture's margin holds it.
const WIDEST: f64 = 11.5;
/// Half of what a picture is wide, at a distance of 1.
const HALF: f64 = 0.48;

/// A random scene: slanted boards, boards with a hole, balls, perhaps a wall behind or a clear pane in front.
pub(super) fn random(seed: u64) -> (LensScene, [f64; 2]) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut scene = LensScene::default();
    if rng.random_bool(0.7) {
        scene = slanted(scene, &mut rng, 8.0, 2.4, false);
    }
    for _ in 0..rng.random_range(3..=5) {
        let z = rng.random_range(1.8..6.0);
        let size = rng.random_range(0.3..1.1);
        scene = match rng.random_range(0..3) {
            0 => slanted(scene, &mut rng, z, size, false),
            1 => slanted(scene, &mut rng, z, size, true),
            _ => {
                let radius = HALF * z * rng.random_range(0.2..0.5);
                let [x, y] = [0; 2].map(|_| HALF * z * rng.random_range(-0.8..0.8));
                scene.ball([x, y, z], radius, mean(&mut rng))
            }
        };
    }
    if rng.random_bool(0.3) {
        scene = scene.pane(0.5, |scene| slanted(scene, &mut rng, 1.1, 1.3, true));
    }
    let focus = rng.random_range(1.8..5.0);
    let circle = |z: f64| (1.0 - focus / z).abs();
    let widest = scene.distances().map(circle).fold(1.0, f64::max);
    (scene, [rng.random_range(4.0_f64..11.0).min(WIDEST / widest), focus])
}

/// Two mean colours.
fn mean(rng: &mut ChaCha8Rng) -> [f64; 2] {
    [0; 2].map(|_| rng.random_range(0.25..0.75))
}

/// With a board whose middle is about `z` away, `size` times as wide as half of the picture, slanted by up to
/// two fifths of that, and perhaps with a hole.
fn slanted(scene: LensScene, rng: &mut ChaCha8Rng, z: f64, size: f64, hole: bool) -> LensScene {
    let side = 2.0 * HALF * z * size * 0.5;
    let is_large = size > 1.2;
    let reach = if is_large { 0.1 } else { 0.9 };
    let [x, y] = [0; 2].map(|_| HALF * z * rng.random_range(-reach..reach));
    let mut turned = |scale: f64| scale * rng.random_range(-0.4..0.4);
    let steep = if is_large { 0.1 * side } else { side };
    let across = [2.0 * side, turned(side), turned(steep)];
    let up = [turned(side), 2.0 * side, turned(steep)];
    let corner = [0, 1, 2].map(|k| [x, y, z][k] - 0.5 * (across[k] + up[k]));
    let pixels = 100.0 * 2.0 * side / z;
    let waves = [0; 2].map(|_| (pixels / rng.random_range(9.0..24.0)).round());
    let mean = mean(rng);
    if hole {
        scene.frame(corner, [across, up], waves, mean)
    } else {
        scene.board(corner, [across, up], waves, mean)
    }
}

/// Scenes of other kinds, made by hand.
pub(super) fn others() -> Vec<Named> {
    let row =
        |name: &str, scene, numbers| Named { name: name.to_owned(), scene, numbers, reach: 1.0 };
    vec![
        row("thin bars", bars(), [5.0, 3.0]),
        row("stairs", stairs(), [8.0, 3.0]),
        row("grazing grid", grid(), [7.0, 2.5]),
        row("20,000 faces, close", close_mesh(), [10.0, 2.2]),
        row("room behind a fence", room(), [6.0, 4.0]),
        row("foliage", foliage(), [8.0, 3.2]),
    ]
}

/// A rippled ball of 20,000 faces that fills half of the picture, before a wall.
fn close_mesh() -> LensScene {
    let wall = [[-4.0, 4.0], [-4.0, 4.0]];
    let scene = LensScene::default().wall(6.0, wall, [14.0, 14.0], [0.3, 0.55]);
    scene.rippled_ball([0.1, -0.05, 2.2], [0.75, 0.06], [125, 80], [0.6, 0.45])
}

/// A room with patterns on all of its sides, behind bars upright and across.
fn room() -> LensScene {
    let (half, depth) = (1.8, 5.0);
    let away = [0.0, 0.0, depth];
    let [across, up] = [[2.0 * half, 0.0, 0.0], [0.0, 2.0 * half, 0.0]];
    let corner = [-half, -half, 3.0];
    let mut scene = LensScene::default()
        .board(corner, [across, away], [12.0, 10.0], [0.5, 0.35])
        .board([-half, half, 3.0], [across, away], [6.0, 6.0], [0.7, 0.7])
        .board(corner, [up, away], [8.0, 9.0], [0.35, 0.5])
        .board([half, -half, 3.0], [up, away], [8.0, 9.0], [0.55, 0.4])
        .wall(3.0 + depth, [[-half, half]; 2], [10.0, 8.0], [0.45, 0.6]);
    for k in -3..=3 {
        let at = 0.27 * f64::from(k);
        let bar = [at - 0.035, at + 0.035];
        scene = scene.wall(2.0, [bar, [-1.5, 1.5]], [1.0, 20.0], [0.8, 0.25]);
        scene = scene.wall(2.02, [[-1.5, 1.5], bar], [20.0, 1.0], [0.75, 0.3]);
    }
    scene
}

/// 500 small leaves at all distances and in all directions, before a wall.
fn foliage() -> LensScene {
    let mut rng = ChaCha8Rng::seed_from_u64(500);
    let wall = [[-5.0, 5.0], [-5.0, 5.0]];
    let mut scene = LensScene::default().wall(7.0, wall, [20.0, 16.0], [0.5, 0.7]);
    for _ in 0..500 {
        let z: f64 = rng.random_range(2.0..6.0);
        let [x, y] = [0; 2].map(|_| HALF * z * rng.random_range(-1.1..1.1));
        let [across, up] = [0; 2].map(|_| [0; 3].map(|_| rng.random_range(-0.14..0.14)));
        let corner = [x, y, z];
        scene = scene.board(corner, [across, up], [1.0, 1.0], mean(&mut rng));
    }
    scene
}

/// Strokes about two pixels wide, as of letters, before a wall: a line of them in front of the focus, one in
/// it, and one behind.
fn bars() -> LensScene {
    let wall = [[-4.0, 4.0], [-4.0, 4.0]];
    let mut scene = LensScene::default().wall(7.0, wall, [6.0, 6.0], [0.6, 0.6]);
    for (line, z) in [2.0, 3.0, 4.5].into_iter().enumerate() {
        let (stroke, top) = (0.022 * z, z * (0.4 - 0.3 * line as f64));
        for letter in 0..8 {
            let left = z * (-0.44 + 0.11 * f64::from(letter));
            let (width, height) = (0.08 * z, 0.18 * z);
            let mean = if letter % 2 == 0 { [0.1, 0.2] } else { [0.9, 0.8] };
            let mut add = |x: f64, y: f64, across: f64, up: f64| {
                let part = [[left + x, left + x + across], [top - y - up, top - y]];
                scene = std::mem::take(&mut scene).wall(z, part, [0.0, 0.0], mean);
            };
            add(0.0, 0.0, stroke, height);
            if letter % 3 != 1 {
                add(stroke, 0.0, width - stroke, stroke);
            }
            if letter % 3 != 2 {
                add(stroke, 0.5 * height, 0.6 * width, stroke);
            }
            if letter % 4 == 3 {
                add(width - stroke, stroke, stroke, height - stroke);
            }
        }
    }
    scene
}

/// Steps that lead away, treads and risers.
fn stairs() -> LensScene {
    let mut scene = LensScene::default();
    for step in 0..10 {
        let k = f64::from(step);
        let (z, y) = (1.7 + 0.45 * k, -0.75 + 0.2 * k);
        let shade = if step % 2 == 0 { [0.35, 0.6] } else { [0.65, 0.4] };
        let riser = [[3.0, 0.0, 0.0], [0.0, 0.2, 0.0]];
        scene = scene.board([-1.5, y - 0.2, z], riser, [9.0, 1.0], shade);
        let tread = [[3.0, 0.0, 0.0], [0.0, 0.0, 0.45]];
        scene = scene.board([-1.5, y, z], tread, [9.0, 1.0], [shade[1], shade[0]]);
    }
    scene
}

/// Bars in a plane that the eye sees at a small angle, over a floor.
fn grid() -> LensScene {
    let floor = [[16.0, 0.0, 0.0], [0.0, 0.0, 9.0]];
    let mut scene = LensScene::default().board([-8.0, -1.0, 1.5], floor, [16.0, 4.0], [0.4, 0.5]);
    for k in -7..=7 {
        let x = 0.32 * f64::from(k);
        scene = scene.board(
            [x, -0.3, 1.3],
            [[0.1, 0.0, 0.0], [0.0, 0.0, 7.0]],
            [0.0, 14.0],
            [0.75, 0.3],
        );
    }
    for k in 0..14 {
        let z = 1.35 + 0.5 * f64::from(k);
        let sides = [[5.0, 0.0, 0.0], [0.0, 0.0, 0.16]];
        scene = scene.board([-2.5, -0.301, z], sides, [20.0, 0.0], [0.7, 0.35]);
    }
    scene
}

/// Scenes in which nothing lies within half a pixel of the focus.
pub(super) fn apart() -> Vec<Named> {
    let lenses = [
        ("board in front", [8.0, 2.8]),
        ("five balls", [8.0, 1.3]),
        ("pane with a hole", [8.0, 2.5]),
        ("thin bars", [10.0, 2.45]),
    ];
    let all: Vec<Named> = named().into_iter().chain(others()).collect();
    let chosen = lenses.into_iter().filter_map(|(name, numbers)| {
        let found = all.iter().find(|one| one.name == name)?;
        Some(Named { name: format!("{name}, none sharp"), numbers, ..found.clone() })
    });
    chosen.collect()
}
