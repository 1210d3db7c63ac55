# One image for every part of Falconer: server, router, simulated world, vehicles, mock model.
# The command says which: `docker run IMAGE serve`, `docker run IMAGE sim demo`, ...

FROM python:3.11-slim AS parts
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
RUN python -m venv /app
WORKDIR /source
COPY requirements.lock .
RUN /app/bin/pip install --require-hashes --requirement requirements.lock
# The kernels from what they are made of alone, for any processor of this architecture: the image
# is built on one machine and run on others.
ENV FALCONER_CACHE_DIR=/app/kernels
COPY solver solver
RUN /app/bin/python -m solver.engines.fast.compile --generic

FROM parts AS build
COPY pyproject.toml README.md LICENSE ./
COPY llm llm
COPY vehicles vehicles
COPY server server
COPY console console
COPY scenarios scenarios
RUN /app/bin/pip wheel --no-deps --no-build-isolation --no-index --wheel-dir /wheels .

# What is large and changes seldom stands in a layer of its own, below our own code.
FROM python:3.11-slim
LABEL org.opencontainers.image.title="Falconer" \
      org.opencontainers.image.licenses="BSD-3-Clause"
COPY --from=parts /app /app
COPY --from=build /wheels /wheels
RUN /app/bin/pip install --no-cache-dir --no-deps --no-index /wheels/*.whl
RUN useradd --system --uid 10001 --create-home --home-dir /data falconer
ENV PATH=/app/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    NUMBA_CPU_NAME=generic \
    FALCONER_CACHE_DIR=/app/kernels \
    MPLCONFIGDIR=/tmp/matplotlib
USER falconer
WORKDIR /data
VOLUME /data
EXPOSE 8000
HEALTHCHECK --interval=5s --timeout=4s --start-period=60s --retries=3 \
    CMD ["python", "-c", "import urllib.request as r; r.urlopen('http://127.0.0.1:8000/healthz', timeout=3)"]
ENTRYPOINT ["falconer"]
CMD ["serve", "--host", "0.0.0.0"]
