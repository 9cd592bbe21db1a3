# docker build -t zbuf-occlude . && docker run --rm -v "$PWD:/clouds" zbuf-occlude generate --out /clouds/occluded
# With a GPU: docker run --gpus all ... (the driver's EGL comes from the host; without it Mesa renders in software)
FROM python:3.12-slim-bookworm

RUN apt-get update \
    && apt-get install -qy --no-install-recommends libegl1 libgl1-mesa-dri libosmesa6 \
    && rm -rf /var/lib/apt/lists/*

# the driver's container runtime hands EGL in only when graphics is asked for; compute alone falls back to software without a word
ENV NVIDIA_VISIBLE_DEVICES=all NVIDIA_DRIVER_CAPABILITIES=compute,utility,graphics
# where the runtime hands the library in and not its notice for GLVND
RUN mkdir -p /usr/share/glvnd/egl_vendor.d \
    && echo '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_nvidia.so.0"}}' \
       > /usr/share/glvnd/egl_vendor.d/10_nvidia.json

COPY . /tmp/source
RUN pip install --no-cache-dir '/tmp/source[report,embree]' && rm -rf /tmp/source

RUN useradd --create-home --uid 1000 occlude && mkdir /clouds && chown occlude /clouds
USER 1000
WORKDIR /clouds
# kept in the user's cache, or each container would compile for a minute; another processor than this one's compiles anew
RUN zbuf-occlude generate --limit 1 --views ring:1@20 --method exact --out /tmp/first && rm -rf /tmp/first
ENTRYPOINT ["zbuf-occlude"]
CMD ["--help"]
