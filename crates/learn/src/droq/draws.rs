//! The random draws of one shard in an update, as plain data: from its streams, or given by a test.

use serde::{Deserialize, Serialize};

use crate::{config::DroqConfig, random::Stream};

/// Number of critics.
pub(crate) const CRITICS: usize = 2;

/// Dropped units of one critic's three passes; each a list of positions for every hidden layer.
#[derive(Clone, Debug, Default)]
pub(crate) struct CriticDrops {
    /// Target critic at the next observation.
    pub target: Vec<Vec<u32>>,
    /// Critic at the action taken.
    pub online: Vec<Vec<u32>>,
    /// Critic inside the actor's loss.
    pub actor: Vec<Vec<u32>>,
}

/// The random draws of one update.
#[derive(Clone, Debug)]
pub(crate) struct Draws {
    /// `[rows, action]`: standard normal noise of the action at the next observation.
    pub next_noise: Vec<f32>,
    /// `[rows, action]`: likewise at the observation, for the actor's loss.
    pub noise: Vec<f32>,
    pub drops: [CriticDrops; CRITICS],
}

/// The random streams of a shard.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ShardStreams {
    pub replay: Stream,
    pub noise: Stream,
    pub dropout: [Stream; CRITICS],
}

impl ShardStreams {
    pub(crate) fn new(seed: u64, shard: usize) -> Self {
        let stream = |purpose: &str| Stream::new(seed, &format!("learner/{purpose}/shard-{shard}"));
        Self {
            replay: stream("replay"),
            noise: stream("noise"),
            dropout: [stream("dropout/critic-0"), stream("dropout/critic-1")],
        }
    }
}

impl Draws {
    pub(crate) fn new(config: &DroqConfig, rows: usize, action_len: usize) -> Self {
        let noise = vec![0.0; rows * action_len];
        let lists = || {
            (config.hidden.iter())
                .map(|&width| Vec::with_capacity(2 * (config.dropout * (rows * width) as f64) as usize + 64))
                .collect::<Vec<_>>()
        };
        let drops = || CriticDrops { target: lists(), online: lists(), actor: lists() };
        Self { next_noise: noise.clone(), noise, drops: [drops(), drops()] }
    }

    pub(crate) fn fill(&mut self, config: &DroqConfig, rows: usize, streams: &mut ShardStreams) {
        streams.noise.fill_normal(&mut self.next_noise);
        streams.noise.fill_normal(&mut self.noise);
        for (drops, stream) in self.drops.iter_mut().zip(&mut streams.dropout) {
            for pass in [&mut drops.target, &mut drops.online, &mut drops.actor] {
                for (layer, &width) in pass.iter_mut().zip(&config.hidden) {
                    stream.fill_drops(config.dropout, rows * width, layer);
                }
            }
        }
    }
}
