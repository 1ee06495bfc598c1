#version 330 core
uniform sampler2D picture;

in vec2 uv;
in float light;
out vec4 colour;

void main()
{
    colour = vec4(texture(picture, uv).rgb * light, 1.0);
}
