#version 330 core
// Positions in the world; colour_0 holds the baked light and the object's id in three bytes.
layout(location = 0) in vec3 position;
layout(location = 1) in vec2 texcoord;
layout(location = 2) in vec4 light_and_id;

uniform mat4 camera;

out vec2 uv;
out float light;
flat out vec3 id;

void main()
{
    gl_Position = camera * vec4(position, 1.0);
    uv = texcoord;
    light = light_and_id.x;
    id = light_and_id.yzw;
}
