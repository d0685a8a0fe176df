//! A scene of your own from a program: load it, change what you like, fit, save.
//!
//! `photographs` stands for yours: it draws an egg from eight sides, and writes a `scene.toml` beside its
//! pictures. The fit starts from a ball. Arguments: a seed, and how many steps.

use std::error::Error;
use std::fs;
use std::path::Path;

use bokashi_scene::arrays::{rows_of, tensor_of_rows, write_npy};
use bokashi_scene::description::Count;
use bokashi_scene::glam::Vec3;
use bokashi_scene::{Scene, SceneFit};

fn main() -> Result<(), Box<dyn Error>> {
    let mut numbers = std::env::args().skip(1).map(|word| word.parse());
    let seed = numbers.next().transpose()?.unwrap_or(0);
    let steps = numbers.next().transpose()?.unwrap_or(200);
    let folder = std::env::temp_dir().join("bokashi-own-scene");
    photographs(&folder)?;

    let mut scene = Scene::load(folder.join("scene.toml"))?;
    scene.description.seed = seed;
    scene.description.stop.steps = Some(Count(steps as usize));
    for object in &mut scene.objects {
        object.positions = object.positions.map(|x| 0.8 * x);
    }

    let mut fit = SceneFit::new(scene)?;
    fit.run(|step| {
        if step.step % 50 == 0 {
            println!("step {:4}  loss {:.2e}", step.step, step.loss);
        }
    })?;

    let (learnt, out) = (fit.learnt()?, folder.join("out"));
    learnt.save_results(&out)?;
    fit.save(out.join("checkpoint.safetensors"))?;
    write_npy(out.join("vertices.npy"), &learnt.objects[0].positions)?;
    let held_out = fit.score(0)?;
    println!("held out    {:.1} dB", held_out.psnr.unwrap_or(f64::NAN));
    println!("vertices    {:.4} from the egg, in the mean", distance(&learnt)?);
    println!("results in  {}", out.display());
    Ok(())
}

/// Half as long again as it is wide.
const EGG: Vec3 = Vec3::new(0.7, 1.05, 0.7);

/// Pictures with opacity, and a scene that names them. The first view is held out.
fn photographs(folder: &Path) -> Result<(), Box<dyn Error>> {
    let text = |image: fn(usize) -> String| {
        let mut text = "[[meshes]]\nname = \"egg\"\nshape = \"sphere\"\nfaces = 1280\n\
             material = { base_color = [0.8, 0.6, 0.3] }\n[learn.vertices]\nsmoothing = 5.0\n\
             [loss]\nsilhouette = 1.0\n[stop]\nviews_per_step = 4\n\
             [[lights]]\nkind = \"directional\"\ndirection = [1, 2, 3]\ncolor = [2, 2, 2]\n\
             [[lights]]\nkind = \"ambient\"\ncolor = [0.5, 0.5, 0.5]\n"
            .to_owned();
        for k in 0..8 {
            let angle = 0.785 * k as f64;
            let (x, y, z) = (4.0 * angle.sin(), 2.0 - 0.5 * k as f64, 4.0 * angle.cos());
            text += &format!("[[views]]\nname = \"{k}\"\n{}held_out = {}\n", image(k), k == 0);
            text += &format!(
                "camera = {{ size = [64, 64], angle = 35, position = [{x}, {y}, {z}] }}\n"
            );
        }
        text
    };
    let file = folder.join("scene.toml");
    fs::create_dir_all(folder)?;
    fs::write(&file, text(|_| String::new()))?;
    let mut truth = Scene::load(&file)?;
    let ball = rows_of::<Vec3>(&truth.objects[0].positions)?;
    let egg: Vec<_> = ball.into_iter().map(|p| EGG * p).collect();
    truth.objects[0].positions = tensor_of_rows(&egg);
    for view in truth.rendered(&[0, 1, 2, 3, 4, 5, 6, 7])? {
        for (name, bytes) in view?.files {
            fs::write(folder.join(name), bytes)?;
        }
    }
    fs::write(&file, text(|k| format!("image = \"{k}.exr\"\n")))?;
    Ok(())
}

/// How far vertices are from the egg's surface, to first order.
fn distance(learnt: &Scene) -> Result<f32, Box<dyn Error>> {
    let vertices = rows_of::<Vec3>(&learnt.objects[0].positions)?;
    let off = vertices.iter().map(|&p| {
        let (unit, slope) = (p / EGG, p / EGG / EGG);
        0.5 * (unit.length_squared() - 1.0).abs() / slope.length()
    });
    Ok(off.sum::<f32>() / vertices.len() as f32)
}
