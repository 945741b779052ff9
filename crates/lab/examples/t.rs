use etude_learn::*;
struct O(std::time::Instant);
impl TrainingObserver for O {
    fn on_evaluation(&mut self, row: &EvaluationRow) {
        let s: Vec<String> = row.scores.iter().map(|s| format!("{} {:.3}", s.name, s.value)).collect();
        println!("{:7.1}s step {} {}", self.0.elapsed().as_secs_f64(), row.step, s.join("  "));
    }
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let song = etude_music::resolve(&a[1]).unwrap();
    let config = etude_lab::resolve(&a[2], None, &a[4..]).unwrap();
    println!("{:?}", etude_lab::train(&song, &config, std::path::Path::new(&a[3]), "t", &mut O(std::time::Instant::now())));
}
