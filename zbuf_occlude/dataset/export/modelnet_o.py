"""ModelNet-O's layout: CLASS/{train,test}/OBJECT_001.xyz ..., a text file per cloud, x y z per line."""

from pathlib import Path

from zbuf_occlude.dataset.export import Exported, Rest
from zbuf_occlude.dataset.export.names import names_of
from zbuf_occlude.dataset.source import Source


def export(source: Source, out: Path) -> Exported:
    """Write a file per cloud."""
    plan, names, files = source.plan, names_of(source.plan), dict[str, list[str]]()
    for split, n_clouds in source.n_clouds.items():
        rest, row, written = Rest(out, split, plan, n_clouds), 0, list[str]()
        for records in source.batches(split):
            rest.write(slice(row, row := row + len(records)), records)
            for record in records:
                mesh_id, number = (
                    int(record["mesh_id"]),
                    int(record["variation"]) * len(plan.views) + int(record["view_id"]),
                )
                name = f"{names.classes[mesh_id]}/{split}/{names.objects[mesh_id]}_{number + 1:03d}.xyz"
                (out / name).parent.mkdir(parents=True, exist_ok=True)
                values = tuple(record["data"].ravel().tolist())
                # nine digits are the number itself; a third of np.savetxt's time
                (out / name).write_text("%.9g %.9g %.9g\n" * len(record["data"]) % values)
                written.append(name)
        files[split] = [*written, rest.name]
    return Exported(files, source.n_clouds)
