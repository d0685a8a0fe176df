//! Stages that rules of `[stop]` end, and the same end on all ranks and after any interruption.

use bokashi_fit::on_ranks;
use bokashi_scene::SceneFit;

use crate::alignment::{bits, scene};

/// Two stages, the first of 5 steps and the second of 6.
fn stages(learn: &str, stop: &str) -> String {
    let stage = |steps: usize| format!("[[stages]]\nsteps = {steps}\nviews_per_step = 2\n");
    format!("{learn}[stop]\n{stop}\n{}reduce = 2\n{}", stage(5), stage(6))
}

#[test]
fn a_stage_ends_by_its_rule_and_the_next_one_follows() {
    let folder = tempfile::tempdir().unwrap();
    let run = |stop: &str| {
        let mut fit =
            SceneFit::new(scene(folder.path(), 24, &stages("[learn.pose]\n", stop))).unwrap();
        assert_eq!(fit.steps(), 11);
        fit.run(|_| ()).unwrap();
        let shortened: Vec<_> = fit.shortened_stages().collect();
        assert!(fit.ended().is_some() || fit.steps_done() == fit.steps());
        (fit.steps_done(), shortened, fit.ended())
    };
    assert_eq!(run(""), (11, Vec::new(), None));
    // The first measure is the best; no other is better by so much.
    let (steps, shortened, ended) = run("held_out = { every = 1, patience = 1, gain = 1000 }");
    assert_eq!((steps, shortened), (2 + 2, vec![(0, [2, 5])]));
    assert!(ended.unwrap().starts_with("held-out views became no better in 1 measures"));
    // Of 6 steps each second, and of 5 too few.
    let (steps, shortened, ended) = run("held_out = { every = 2, patience = 2, gain = 1000 }");
    assert_eq!((steps, shortened.len(), ended.is_some()), (5 + 6, 0, true));
    assert_eq!(run("held_out = { every = 4, patience = 1, gain = 1000 }").0, 11);
    // Views differ from step to step, and so do losses.
    let (steps, shortened, ended) = run("patience = 1");
    assert!(steps < 11 && shortened.len() + usize::from(ended.is_some()) > 0);
    // A loss below the limit ends the fit in any stage.
    let (steps, _, ended) = run("loss_below = 1e3");
    assert_eq!((steps, ended.is_some()), (1, true));
}

#[test]
fn a_stage_ends_at_the_same_step_on_all_ranks_and_after_an_interruption() {
    let folder = tempfile::tempdir().unwrap();
    // Measures that align views take long.
    let few: (&[usize], &[u64]) = (&[2], &[1, 2, 3]);
    for (learn, gain, end, (sizes, steps)) in [
        ("[learn.pose]\n", 1000.0, 4, (&[2, 3][..], &[0, 1, 2, 3, 4][..])),
        ("[learn.pose]\n", 0.01, 11, few),
        ("[learn.pose]\n[learn.cameras]\n", 1000.0, 4, few),
    ] {
        let rule = format!("held_out = {{ every = 1, patience = 1, gain = {gain:?} }}");
        let load = || scene(folder.path(), 24, &stages(learn, &rule));
        let run = |mut fit: SceneFit| {
            fit.run(|_| ()).unwrap();
            (fit.steps_done(), fit.shortened_stages().collect::<Vec<_>>(), fit.ended(), bits(&fit))
        };
        let whole = run(SceneFit::new(load()).unwrap());
        println!("{learn:?}, {gain}: {:?}", &whole.1);
        assert!(whole.0 <= end && (gain < 1.0 || whole.0 == end), "{}", whole.0);
        let loaded = load();
        for &size in sizes {
            for found in
                on_ranks(size, |ranks| run(SceneFit::among(loaded.clone(), ranks).unwrap()))
            {
                assert!(found == whole, "{size} ranks");
            }
        }
        let saved = folder.path().join("saved");
        for &step in steps {
            let mut fit = SceneFit::new(load()).unwrap();
            for _ in 0..step {
                fit.step().unwrap();
            }
            fit.save(&saved).unwrap();
            let again = SceneFit::resume(load(), &saved).unwrap();
            assert_eq!((again.changed().len(), again.ended()), (0, fit.ended()));
            assert!(run(again) == whole, "after {step} steps");
        }
    }
}
