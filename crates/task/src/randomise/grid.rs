//! A fixed set of worlds that covers the range of the randomisation evenly, to compare policies on.

use etude_learn::seed;
use etude_stage::params::PhysicalParams;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_pcg::Pcg64;

use super::Randomisation;

impl Randomisation {
    /// `worlds` worlds: a Latin hypercube (McKay, Beckman, Conover 1979). The range of each
    /// randomised parameter is divided into `worlds` equally likely parts, and each world takes the
    /// middle of another part. The same arguments give the same worlds.
    pub fn grid(&self, worlds: usize, root_seed: u64) -> Vec<PhysicalParams> {
        let mut grid = vec![self.nominal.clone(); worlds];
        let mut parts: Vec<usize> = (0..worlds).collect();
        for spread in &self.spreads {
            // One random stream a parameter: the order of its parts does not depend on the others.
            let purpose = format!("grid/{}", spread.id.path());
            parts.sort_unstable();
            parts.shuffle(&mut Pcg64::seed_from_u64(seed::split(root_seed, &purpose)));
            for (params, &part) in grid.iter_mut().zip(&parts) {
                let share = (part as f64 + 0.5) / worlds as f64;
                spread.set(params, self.intensity, spread.widest() * (2.0 * share - 1.0));
            }
        }
        grid.into_iter().map(|params| self.guard(params)).collect()
    }
}
