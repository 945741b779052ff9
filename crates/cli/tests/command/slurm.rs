//! The Slurm launcher against a real Slurm of one node, which the test starts: a stopped trial
//! saves itself and is requeued, one that was killed half way goes on too, and the results are
//! those of the local launcher, byte for byte.
//!
//! Needs `slurmctld`, `slurmd`, `sbatch` and `munged`, and root, without which `slurmd` starts no
//! jobs (Debian, Ubuntu: `apt-get install -y --no-install-recommends slurmctld slurmd slurm-client
//! munge`).

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::experiments::{FOUR, results, tiny};
use crate::processes::{self, with_arguments};
use crate::{Sandbox, errors};

/// How long anything of the cluster's may take.
const PATIENCE: Duration = Duration::from_secs(120);

/// A cluster of one node, which ends with the test.
struct Cluster {
    folder: tempfile::TempDir,
    daemons: Vec<Child>,
}

/// Says why nothing is tested; CI, which installs Slurm, must test.
fn skip(why: &str) -> Option<Cluster> {
    assert!(std::env::var_os("ETUDE_NEEDS_ALL").is_none(), "{why}");
    println!("skipped: {why}");
    None
}

impl Cluster {
    /// Starts one; `None`, with the reason printed, where it cannot be.
    fn start() -> Option<Self> {
        let there = |name: &str| {
            let places = ["/usr/sbin", "/usr/bin", "/sbin", "/usr/local/sbin", "/usr/local/bin"];
            places.into_iter().map(|place| Path::new(place).join(name)).find(|path| path.is_file())
        };
        let Some([munged, slurmctld, slurmd]) = ["munged", "slurmctld", "slurmd"]
            .map(there)
            .into_iter()
            .collect::<Option<Vec<PathBuf>>>()
            .and_then(|found| <[PathBuf; 3]>::try_from(found).ok())
        else {
            return skip("there is no Slurm here");
        };
        let who = Command::new("id").arg("-u").output().unwrap();
        if who.stdout != b"0\n" {
            return skip("slurmd needs root");
        }
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().to_path_buf();
        let path = |name: &str| root.join(name).display().to_string();
        for name in ["spool", "state"] {
            std::fs::create_dir(path(name)).unwrap();
        }
        let mut key = [0; 1024];
        std::fs::File::open("/dev/urandom").unwrap().read_exact(&mut key).unwrap();
        std::fs::write(path("munge.key"), key).unwrap();
        Command::new("chmod").args(["600", &path("munge.key")]).status().unwrap();
        // Free now; nobody else starts servers meanwhile.
        let ports: [u16; 2] = std::array::from_fn(|_| {
            std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
        });
        let host = Command::new("hostname").output().unwrap();
        let host = String::from_utf8(host.stdout).unwrap().trim().to_string();
        let config = format!(
            "ClusterName=etude\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser=root\nSlurmdUser=root\n\
             SlurmctldPort={}\nSlurmdPort={}\nAuthType=auth/munge\nAuthInfo=socket={}\nCredType=cred/munge\n\
             StateSaveLocation={}\nSlurmdSpoolDir={}\nSlurmctldPidFile={}\nSlurmdPidFile={}\n\
             ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nSelectType=select/cons_tres\n\
             SelectTypeParameters=CR_Core\nAccountingStorageType=accounting_storage/none\n\
             JobAcctGatherType=jobacct_gather/none\nMpiDefault=none\nSwitchType=switch/none\nReturnToService=2\nKillWait=2\n\
             SchedulerParameters=sched_interval=1\nNodeName=node NodeHostname={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN\n\
             PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n",
            ports[0],
            ports[1],
            path("munge.sock"),
            path("state"),
            path("spool"),
            path("slurmctld.pid"),
            path("slurmd.pid"),
        );
        std::fs::write(path("slurm.conf"), config).unwrap();
        let mut cluster = Self { folder, daemons: Vec::new() };
        cluster.daemon(Command::new(munged).args([
            "--foreground",
            "--force",
            &format!("--key-file={}", path("munge.key")),
            &format!("--socket={}", path("munge.sock")),
            &format!("--log-file={}", path("munge.log")),
            &format!("--pid-file={}", path("munge.pid")),
            &format!("--seed-file={}", path("munge.seed")),
        ]));
        cluster.wait("munged is up", || Path::new(&path("munge.sock")).exists());
        cluster.daemon(Command::new(slurmctld).args(["-D", "-c", "-f", &path("slurm.conf")]));
        cluster.daemon(Command::new(slurmd).args(["-D", "-N", "node", "-f", &path("slurm.conf")]));
        cluster.wait("the node is idle", || cluster.say("sinfo", &["-h", "-o", "%t"]).trim() == "idle");
        Some(cluster)
    }

    fn daemon(&mut self, command: &mut Command) {
        let log =
            std::fs::File::create(self.folder.path().join(format!("{}.log", self.daemons.len()))).unwrap();
        let errors = log.try_clone().unwrap();
        self.daemons.push(command.stdin(Stdio::null()).stdout(log).stderr(errors).spawn().unwrap());
    }

    fn config(&self) -> PathBuf {
        self.folder.path().join("slurm.conf")
    }

    fn run(&self, program: &str, args: &[&str]) -> Output {
        Command::new(program).args(args).env("SLURM_CONF", self.config()).output().unwrap()
    }

    fn say(&self, program: &str, args: &[&str]) -> String {
        String::from_utf8_lossy(&self.run(program, args).stdout).into_owned()
    }

    /// Waits until something is so.
    fn wait(&self, what: &str, is_so: impl Fn() -> bool) {
        let begun = Instant::now();
        while !is_so() {
            if begun.elapsed() > PATIENCE {
                let queue = self.say("squeue", &[]);
                let logs: String = (0..self.daemons.len())
                    .filter_map(|index| {
                        std::fs::read_to_string(self.folder.path().join(format!("{index}.log"))).ok()
                    })
                    .collect();
                panic!("waited in vain until {what}\n{queue}\n{logs}");
            }
            sleep(Duration::from_millis(100));
        }
    }

    /// Requeued jobs wait for two minutes; these need not.
    fn begin_now(&self) {
        for job in self.say("squeue", &["-h", "-r", "-t", "PD", "-o", "%i"]).lines() {
            self.run("scontrol", &["update", &format!("jobid={job}"), "StartTime=now"]);
        }
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        self.run("scancel", &["--full", "-u", "root"]);
        for daemon in self.daemons.iter_mut().rev() {
            let _ = Command::new("kill").arg(daemon.id().to_string()).status();
            let _ = daemon.wait();
        }
    }
}

#[test]
fn a_sweep_through_slurm_has_the_results_of_the_local_launcher() {
    let Some(cluster) = Cluster::start() else { return };
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.path("four.toml"), FOUR).unwrap();
    // Long enough to be stopped on its way.
    let longer = ["trainer.total_steps=16000", "trainer.evaluate_every_steps=2000"];
    let run = |args: &str| {
        let mut command = tiny(&sandbox, &format!("experiment run four.toml {args}"));
        command.args(longer.iter().flat_map(|set| ["--set", set])).env("SLURM_CONF", cluster.config());
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", errors(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    run("--runs-dir here");
    let said = run("--runs-dir there --launcher slurm --time 00:20:00");
    let job = said.trim_start_matches("job ").split(':').next().unwrap().to_string();
    let plan = tiny(&sandbox, "experiment plan four.toml")
        .args(longer.iter().flat_map(|set| ["--set", set]))
        .output();
    let ids: Vec<String> = String::from_utf8(plan.unwrap().stdout)
        .unwrap()
        .lines()
        .map(|line| {
            serde_json::from_str::<serde_json::Value>(line).unwrap()["id"].as_str().unwrap().to_string()
        })
        .collect();
    let metrics = |task: usize| sandbox.path("there").join(&ids[task]).join("training/metrics.jsonl");
    let evaluated =
        |task: usize| std::fs::read_to_string(metrics(task)).is_ok_and(|text| text.contains("eval/"));
    cluster.wait("the first two trials are half way", || evaluated(0) && evaluated(1));
    // One is killed; the other is told that its time is up, saves itself and asks to be requeued.
    // `scancel` goes on telling it, so nobody waits for it.
    let runs = sandbox.path("there").display().to_string();
    let killed = with_arguments(&["1", "--runs-dir", &runs]);
    assert!(!killed.is_empty(), "the second trial is running");
    killed.into_iter().for_each(|task| processes::signal(task, "KILL"));
    let mut told = Command::new("scancel");
    told.args(["--signal=USR1", "--batch", &format!("{job}_0")]).env("SLURM_CONF", cluster.config());
    let mut told = told.stderr(Stdio::null()).spawn().unwrap();
    let show = || cluster.say("scontrol", &["show", "job", &format!("{job}_1")]);
    cluster.wait("the other has failed", || show().contains("JobState=FAILED"));
    // The killed one is handed over again by hand.
    cluster.run("scontrol", &["requeue", &format!("{job}_1")]);
    for task in [0, 1] {
        let show = || cluster.say("scontrol", &["show", "job", &format!("{job}_{task}")]);
        cluster.wait("it is requeued", || show().contains("Restarts=1"));
    }
    let _ = told.kill();
    let _ = told.wait();
    cluster.wait("all have ended", || {
        cluster.begin_now();
        cluster.say("squeue", &["-h"]).trim().is_empty()
    });
    assert!(results(&sandbox, "there") == results(&sandbox, "here"));
    assert!(run("--runs-dir there --launcher slurm").contains("all trials are done"));
}
