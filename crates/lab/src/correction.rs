//! A correction that was learned on a robot, in its file: with the song, the policy and the robot
//! that it is for.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use etude_music::Song;
use etude_perform::session::RigChoice;
use etude_perform::{Correction, Mode};
use serde::{Deserialize, Serialize};

use crate::json_files::load;
use crate::loaded_player::{LoadedPlayer, load_player};

/// A correction that was learned, with all that it is for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CorrectionFile {
    /// Title of the song.
    pub(crate) song: String,
    /// What the correction is only right for.
    pub(crate) only_for: OnlyFor,
    /// The policy that plays it.
    pub(crate) policy: PathBuf,
    /// The mode in which it was learned.
    pub mode: Mode,
    /// The latency compensation, s.
    pub(crate) latency_compensation_secs: f64,
    /// The correction.
    pub correction: Correction,
}

/// With another one of these the motion is another, or the robot misses it otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct OnlyFor {
    /// Name of the rig, and of the twin parameters.
    robot: String,
    /// Checksum of the song's notes.
    notes: u32,
    /// Checksum of the policy's file.
    policy: u32,
}

impl OnlyFor {
    pub(crate) fn new(song: &Song, rig: &RigChoice, player: &LoadedPlayer) -> anyhow::Result<Self> {
        let file = player.file().map(std::fs::read).transpose()?.unwrap_or_default();
        Ok(Self { robot: rig.label(), notes: crc32c::crc32c(&song.to_midi()), policy: crc32c::crc32c(&file) })
    }
}

impl CorrectionFile {
    /// Loads it.
    ///
    /// # Errors
    /// If there is none, or it is damaged.
    pub fn load(path: &Path) -> anyhow::Result<Self> {
        load(path)?
            .with_context(|| format!("there is no {}; `etude rehearse --adapt` makes it", path.display()))
    }

    /// The player that it was learned with, by whose plan `song` is played on `rig`.
    ///
    /// # Errors
    /// If the correction is for something else, or the policy cannot be loaded.
    pub fn player(&self, song: &Song, rig: &RigChoice) -> anyhow::Result<LoadedPlayer> {
        if self.song != song.title() {
            bail!(
                "the correction is for {}, not for {}; learn one for it with `etude rehearse --adapt`",
                self.song,
                song.title()
            );
        }
        let mut player = load_player(&self.policy)?;
        let now = OnlyFor::new(song, rig, &player)?;
        if now.robot != self.only_for.robot {
            bail!(
                "the correction is for the robot `{}`, not for `{}`; learn one for it with `etude rehearse --adapt`",
                self.only_for.robot,
                now.robot
            );
        }
        if now != self.only_for {
            bail!(
                "the notes or the policy {} have changed since the correction was learned: learn it again with `etude rehearse \
                 --adapt`, in another folder",
                self.policy.display()
            );
        }
        player.config.task.key_schedule.latency_compensation_secs = self.latency_compensation_secs;
        Ok(player)
    }
}
