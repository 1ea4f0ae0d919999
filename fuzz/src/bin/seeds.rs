//! Writes the inputs that fuzzing begins with: `corpus/<target>/seed-<n>`.

use std::fs;
use std::io::Write;
use std::path::Path;

use reactsim_fuzz::made;

fn main() -> std::io::Result<()> {
    let [womd, few] = made::womd();
    let framed = made::framed(&[few.clone(), womd.clone()]);
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gzip.write_all(&framed)?;
    let mini = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/mini");
    let mut json = vec![made::HAND.as_bytes().to_vec()];
    for name in ["crossing.json", "merge.json", "platoon.json"] {
        json.push(fs::read(mini.join(name))?);
    }
    let selection =
        |keys: &str| format!(r#"{{"format": "reactsim-nuplan-v1", "logs": ["logs"]{keys}}}"#).into_bytes();
    let list = [selection("").as_slice(), &[0], made::LIST.as_bytes()].concat();
    // Told by bytes: a database, a table, a column, rows, what is done. Any bytes tell something.
    let edits = (0..20_u8)
        .map(|i| (0..64_u8).map(|k| k.wrapping_mul(i.wrapping_mul(37) | 1).wrapping_add(i)).collect());
    let all: Vec<(&str, Vec<Vec<u8>>)> = vec![
        ("womd", vec![womd, few]),
        ("womd_raw", vec![zstd::encode_all(&framed[..], 1)?, gzip.finish()?, framed]),
        ("native", made::with_whole_pages(made::HAND.as_bytes()).to_vec()),
        ("json", json),
        ("gpudrive", vec![made::gpudrive(), made::gpudrive_old()]),
        ("scenarionet", vec![made::scenarionet()]),
        ("argoverse2_tracks", vec![made::argoverse2_tracks()]),
        ("argoverse2_map", vec![made::argoverse2_map()]),
        ("nuplan_log", vec![made::nuplan_log()]),
        ("nuplan_map", vec![made::nuplan_map()]),
        ("nuplan_edits", edits.collect()),
        (
            "nuplan_selection",
            vec![
                list,
                selection(r#", "maps": "maps", "tokens": ["7000000000000014", "700000000000001F"]"#),
                selection(r#", "tags": ["inner", "edge"], "every_seconds": 0.5"#),
            ],
        ),
    ];
    for (target, seeds) in all {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
        fs::create_dir_all(&folder)?;
        for (i, seed) in seeds.iter().enumerate() {
            fs::write(folder.join(format!("seed-{i}")), seed)?;
            println!("{target} seed-{i}: {} bytes", seed.len());
        }
    }
    Ok(fs::remove_dir_all(reactsim_fuzz::folder())?)
}
