#!/usr/bin/env bash
# The whole pipeline, small: demonstrations, ACT trained on them for minutes, evaluation beside the experts, a report.
#   tools/demo.sh [FOLDER]      run it through `make demo`; what a step has finished is not done again
set -euo pipefail

out=${1:-outputs/demo}
configs=$(dirname "$0")/../configs
camera=(--env.camera.height=96 --env.camera.width=128)
episodes=20
export HF_HUB_OFFLINE=${HF_HUB_OFFLINE:-1} TOKENIZERS_PARALLELISM=false
mkdir -p "$out"
begun=$SECONDS

step() { printf '\n\033[1m[%s/5] %s\033[0m  (%d s so far)\n' "$1" "$2" $((SECONDS - begun)); }
reuse() { echo "already there: $1"; }

step 1 "demonstrations: the meta-RL expert flies, the best flights are rendered into a LeRobotDataset"
if [ -f "$out/dataset/meta/info.json" ]; then reuse "$out/dataset"; else
    spacedock demos --num_episodes=16 --camera.height=96 --camera.width=128 \
        --repo_id=spacedock/demo --root="$out/dataset"
fi

step 2 "ACT: stock lerobot-train, a few minutes on the CPU (it learns the approach; docking takes half an hour: configs/act_cpu.yaml)"
checkpoint=$out/act/checkpoints/last/pretrained_model
if [ -f "$checkpoint/model.safetensors" ]; then reuse "$checkpoint"; else
    rm -rf "$out/act"
    lerobot-train --config_path="$configs/act_smoke.yaml" --dataset.repo_id=spacedock/demo \
        --dataset.root="$out/dataset" --output_dir="$out/act" --steps=200 --save_freq=200 --env_eval_freq=0
fi

evaluate() { # label, task, then the policy's flags
    local folder=$out/eval/$1-$2 task=$2; shift 2
    if [ -f "$folder/eval_info.json" ]; then reuse "$folder"; return; fi
    rm -rf "$folder"
    lerobot-eval --config_path="$configs/eval_$task.yaml" "${camera[@]}" \
        --eval.n_episodes=$episodes --output_dir="$folder" --policy.device=cpu "$@" 2>&1 | tee "$out/eval.log" \
        | grep --line-buffered -oE "Stepping through eval batches: +[0-9]+%|'pc_success': [0-9.]+" | uniq \
        || { tail -n 30 "$out/eval.log" >&2; exit 1; }
}

for task in paper contact; do
    step $([ $task = paper ] && echo 3 || echo 4) "stock lerobot-eval, $episodes episodes, the same seeds: $task task"
    echo "ACT, temporal ensembling"
    evaluate act $task --policy.path="$checkpoint" --policy.n_action_steps=1 --policy.temporal_ensemble_coeff=0.01
    echo "meta-RL expert"
    evaluate meta-rl $task --policy.type=spacedock_meta_rl --env.obs_type=agent_pos
    echo "minimum-energy MPC"
    evaluate mpc $task --policy.type=spacedock_mpc --env.obs_type=agent_pos
done

step 5 "reports: tables and figures, the paper's numbers beside these"
# How much the shipped expert saw, in the form that the report reads.
python - > "$out/expert_training.json" <<'PYTHON'
import json
from lerobot_spacedock.expert.checkpoint import SHIPPED
print(json.dumps(json.loads(SHIPPED.with_suffix(".json").read_text())["training"]))
PYTHON
for task in paper contact; do
    spacedock report --out="$out/report-$task" --title="SpaceDock demo, $task task" \
        --demos ACT="$out/dataset" --training RL="$out/expert_training.json" --runs \
        ACT="$out/eval/act-$task/episodes" RL="$out/eval/meta-rl-$task/episodes" MPC="$out/eval/mpc-$task/episodes"
done

echo
echo "Done in $((SECONDS - begun)) s. Open:"
for task in paper contact; do ls "$out/report-$task"/*.html; done
