//! Trials of Sim2Real2Sim: rehearsals, and fits alone.

use std::collections::BTreeMap;
use std::path::Path;

use etude_identify::Progress;
use etude_lab::{
    Identification, IdentifyMethod, RehearsalConfig, RehearsalStep, SafetyStop, find_song, identify_robot,
    record_excitations, rehearse_on_robot, slug,
};
use etude_perform::session::{TWIN, rig_choice};
use etude_perform::{Excitation, Job};
use etude_show::RehearsalPage;

use super::{RunningTrial, SEED_STRIDE, TRAINING_AND_REHEARSALS_SHARE, result_row};
use crate::config::RehearseConfig;
use crate::curves::FitCurve;
use crate::outcome::{ResultRow, TrialResult, TrialTimes};
use crate::trial::TrainingConfig;

/// Name of the file with the curve of a fit.
const CURVE: &str = "curve.json";

impl RunningTrial<'_, '_> {
    /// The rows of a policy's rehearsals: with each parameter set of the twin, mode and fit.
    pub(super) fn rehearse_on_twins(
        &mut self,
        training: &TrainingConfig,
        rehearse: &RehearseConfig,
        seed: u64,
    ) -> anyhow::Result<Vec<ResultRow>> {
        let song = training.song.clone().unwrap_or_default();
        let modes = rehearse.modes.iter().flat_map(|mode| rehearse.fits.iter().map(move |fit| (mode, fit)));
        let sets = rehearse.twin_params.iter();
        let all: Vec<_> =
            sets.flat_map(|set| modes.clone().map(move |(mode, fit)| (set, mode, fit))).collect();
        let mut rows = Vec::new();
        for (index, (twin_params, mode, fit)) in all.iter().enumerate() {
            let steps = rehearse.steps.map(|steps| format!("trainer.total_steps={steps}"));
            let config = RehearsalConfig {
                song: song.clone(),
                rig: TWIN.to_string(),
                twin_params: Some(twin_params.to_string()),
                iterations: rehearse.iterations,
                runs: rehearse.runs,
                mode: **mode,
                preset: training.preset.clone(),
                overrides: training.set.iter().cloned().chain(steps).collect(),
                policy: Some(self.folder.join("training")),
                simulator: None,
                fit: **fit,
                evaluations: rehearse.evaluations,
                seed,
                threads: Some(self.threads),
            };
            let labels = [
                ("twin_params", twin_params.to_string()),
                ("mode", mode.to_string()),
                ("fit", fit.to_string()),
            ];
            let folder = slug(&format!("{twin_params}-{mode}-{fit}"));
            let done = index as f64 / all.len() as f64;
            let share = |part: f64| {
                let done = done + part / all.len() as f64;
                TRAINING_AND_REHEARSALS_SHARE + (1.0 - TRAINING_AND_REHEARSALS_SHARE) * done
            };
            // A twin that stops for safety ends its rehearsal, and is counted.
            let folder = self.folder.join("rehearsal").join(folder);
            match self.rehearse(&config, &folder, &labels, share) {
                Err(error) if error.is::<SafetyStop>() => {
                    rows.push(result_row(&labels, &[("complete", 0.0)]));
                }
                done => rows.extend(done?),
            }
        }
        Ok(rows)
    }

    fn rehearse(
        &mut self,
        config: &RehearsalConfig,
        folder: &Path,
        labels: &[(&str, String)],
        share: impl Fn(f64) -> f64 + Sync,
    ) -> anyhow::Result<Vec<ResultRow>> {
        let song = find_song(&config.song, false)?;
        let rig = rig_choice(&config.rig, config.twin_params.as_deref().unwrap_or_default())?;
        let interrupt = self.job.interrupt();
        let parts = (config.iterations + 1) as f64;
        let mut page = RehearsalPage::new(config, folder);
        let mut on_progress = |step: &RehearsalStep| match step {
            RehearsalStep::Identifying(number, at) => {
                let phase = format!("iteration {number}: {}", at.pass.name());
                self.report(&phase, share(*number as f64 / parts), None);
            }
            RehearsalStep::Training(number, at) => {
                let part = (*number as f64 + at.share()) / parts;
                self.report(&format!("iteration {number}: training"), share(part), at.best_f1);
            }
            RehearsalStep::Iteration(iteration) => page.add(iteration),
            _ => {}
        };
        let mut job = Job::new(&mut on_progress, interrupt);
        let iterations = rehearse_on_robot(&song, &rig, config, folder, &mut job)?;
        page.checked()?;
        let rows = iterations.iter().map(|iteration| {
            let scores = &iteration.scores;
            let mut values = vec![
                ("complete", 1.0),
                ("sim_f1", scores.sim_f1),
                ("f1", scores.robot_f1),
                ("onset_f1", scores.notes.onset_f1),
                ("onset_f1_without_lag", scores.notes.onset_f1_without_lag),
                ("notes_right", scores.notes.notes_right),
                ("notes_wrong", scores.notes.notes_wrong),
                ("gap", scores.gap),
            ];
            if let Some([before, after]) = iteration.held_out_rad {
                values.extend([("held_out_before", before), ("held_out_after", after)]);
            }
            if let Some(prediction) = iteration.prediction {
                values.extend([
                    ("predicted_before", prediction.before_fit_f1),
                    ("predicted_after", prediction.after_fit_f1),
                    ("predicted_played", prediction.played_f1),
                ]);
            }
            let number = [("iteration", iteration.iteration.to_string())];
            result_row(&[labels, &number].concat(), &values)
        });
        Ok(rows.collect())
    }

    pub(super) fn identify(
        &mut self,
        twin_params: &str,
        method: IdentifyMethod,
        evaluations: Option<u64>,
        seed: u64,
    ) -> anyhow::Result<(TrialResult, TrialTimes)> {
        let rig = rig_choice(TWIN, twin_params)?;
        let excitations = self.folder.join("recordings");
        let interrupt = self.job.interrupt();
        self.report("recording", 0.0, None);
        let noise = SEED_STRIDE.wrapping_mul(seed);
        let recordings =
            record_excitations(&rig, &Excitation::ALL, &excitations, noise, interrupt, &mut |_, _| {})?;
        let (held_out, start) = (Vec::new(), BTreeMap::new());
        let what = Identification { recordings, held_out, method, evaluations, seed, start };
        let folder = self.folder.join("identified");
        let mut curve = FitCurve::open(&self.folder.join(CURVE))?;
        let mut written = Ok(());
        let mut on_progress = |at: &Progress| {
            let share = at.ended[0] as f64 / at.ended[1].max(1) as f64;
            self.report(at.pass.name(), share, None);
            if written.is_ok() {
                written = curve.add(at);
            }
        };
        let report = identify_robot(&what, &folder, &mut Job::new(&mut on_progress, interrupt))?;
        written?;
        let errors = &report.held_out_errors;
        let replays: u64 = report.identified.passes.iter().map(|end| end.replays).sum();
        let secs: f64 = report.identified.passes.iter().map(|end| end.secs).sum();
        let values = [
            ("held_out_before", errors.fingers[0]),
            ("held_out_after", errors.fingers[1]),
            ("noise", errors.fingers_noise),
            ("times_less", errors.fingers[0] / errors.fingers[1]),
            ("replays", replays as f64),
        ];
        Ok((self.result(vec![result_row(&[], &values)], curve.points()), self.times(secs, Vec::new())))
    }
}
