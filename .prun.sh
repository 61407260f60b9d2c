exec nice timeout 580 /work/main/.venv/bin/python -m pytest -q "$@"
